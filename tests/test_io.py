"""Files written whole or not at all, values as strict JSON, arrays kept on disk, addresses of databases."""

import json
import logging
import os
import struct
import zlib
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import GeometryError, OutputError
from gvla2.io import foreign
from gvla2.io.array_cache import cache_folder, cached_arrays
from gvla2.io.database_url import parsed, shown
from gvla2.io.files import plain, write_json, write_text, write_whole


class Colour(Enum):
    RED = "red"


@dataclass
class Pair:
    a: float
    b: np.ndarray


def test_json_takes_what_numpy_gives(tmp_path: Path) -> None:
    value = {
        "f32": np.float32(0.5),
        "flag": np.bool_(True),
        "rows": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        3: {2, 1},
        "pair": Pair(float("-inf"), np.zeros(2)),
        "enum": Colour.RED,
        "path": Path("x"),
        "bytes": b"\x01",
    }
    assert json.loads(write_json(tmp_path / "a.json", value).read_text(encoding="utf-8")) == {
        "f32": 0.5,
        "flag": True,
        "rows": [[1.0, None], [None, 2.0]],
        "3": [1, 2],
        "pair": {"a": None, "b": [0.0, 0.0]},
        "enum": "red",
        "path": "x",
        "bytes": "01",
    }


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    )
)
@settings(max_examples=60, deadline=None)
def test_anything_becomes_strict_json(value: object) -> None:
    text = json.dumps(plain(value), allow_nan=False)
    assert plain(json.loads(text)) == plain(value)


def test_text_that_is_not_unicode_is_written(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.txt", "caf\udce9 µ")
    assert path.read_text(encoding="utf-8") == "caf\\udce9 µ"


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_an_interrupted_write_keeps_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    path = write_text(tmp_path / "result.json", "old")

    def fail(descriptor: int) -> None:
        raise error

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OutputError if isinstance(error, OSError) else KeyboardInterrupt):
        write_text(path, "new and longer")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_new_files_get_the_mode_that_open_would_give(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "a", b"")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file stands where the folder should be")
    with pytest.raises(OutputError, match=r"runs.*hydra\.run\.dir"):
        write_text(tmp_path / "runs" / "result.json", "x")
    with pytest.raises(OutputError, match="missing"):
        write_whole(tmp_path / "missing" / "a", b"")


def test_the_cache_is_where_the_environment_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("GVLA2_CACHE", str(tmp_path / "cache"))
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.delenv("GVLA2_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "gvla2"


class Maker:
    """Counts how often the arrays were made."""

    def __init__(self) -> None:
        self.made = 0

    def __call__(self) -> dict[str, np.ndarray]:
        self.made += 1
        return {"points": np.arange(6.0).reshape(2, 3), "count": np.array(self.made)}


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_are_made_once_for_a_key_and_again_where_the_entry_is_damaged(
    tmp_path: Path, compressed: bool, caplog: pytest.LogCaptureFixture
) -> None:
    make = Maker()
    for key, count in (("a", 1), ("a", 1), ("b", 2)):
        found = cached_arrays(tmp_path / "kept", key, make, compressed=compressed)
        np.testing.assert_array_equal(found["points"], [[0, 1, 2], [3, 4, 5]])
        assert (make.made, found["count"]) == (count, count)
    for entry in (tmp_path / "kept").iterdir():
        entry.write_bytes(entry.read_bytes()[:100])
    with caplog.at_level(logging.WARNING):
        assert cached_arrays(tmp_path / "kept", "a", make)["count"] == 3
    assert "is damaged" in caplog.text


def test_a_cache_that_cannot_be_written_only_costs_time(tmp_path: Path, caplog) -> None:
    (tmp_path / "occupied").write_text("a file")
    make = Maker()
    with caplog.at_level(logging.WARNING):
        for count in (1, 2):
            assert cached_arrays(tmp_path / "occupied", "a", make)["count"] == count
    assert "could not be cached" in caplog.text


def test_special_characters_of_a_password_need_no_escaping() -> None:
    for password in ("hush", "hu@sh", "hu/sh", "hu:sh", "hu#sh"):
        url = parsed(f"postgresql+psycopg://robot:{password}@host:5/bank?sslmode=prefer")
        assert (url.username, url.password, url.host, url.port) == ("robot", password, "host", 5)
        assert (url.database, dict(url.query)) == ("bank", {"sslmode": "prefer"})
    assert parsed("postgres://robot:hu%40sh@host/bank").password == "hu@sh"
    assert parsed("postgresql:///bank?host=/run/pg").query["host"] == "/run/pg"


def test_no_message_has_a_password() -> None:
    assert shown("postgresql://robot:hu@s/h@host/bank") == "postgresql://...@host/bank"
    assert (
        shown("postgresql://host/bank?user=a&password=hush") == "postgresql://host/bank?user=a&password=..."
    )


def test_what_unpacks_to_more_than_memory_and_what_is_no_file_are_refused(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr(foreign, "MOST_BYTES", 2000)
    np.savez_compressed(tmp_path / "bomb.npz", depth=np.zeros(1000), other=np.zeros(9))
    np.save(tmp_path / "bomb.npy", np.zeros(1000))
    size = struct.pack(">4sIIBBBBB", b"IHDR", 30_000, 20_000, 8, 2, 0, 0, 0)
    picture = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + size + struct.pack(">I", zlib.crc32(size))
    (tmp_path / "bomb.png").write_bytes(picture + bytes(4) + b"IDAT")
    for name in ("pipe.npz", "pipe.npy", "pipe.png"):
        os.mkfifo(tmp_path / name)
    for stem, words in (("bomb", "maximum|exceeds limit"), ("pipe", "a pipe or a device")):
        for suffix, read in (
            ("npz", lambda path: foreign.read_arrays(path, "the depth", ("depth",))),
            ("npy", lambda path: foreign.read_array(path, "the depth")),
            ("png", foreign.read_picture),
        ):
            with pytest.raises(GeometryError, match=rf"{stem}\.{suffix}: .*({words})"):
                read(tmp_path / f"{stem}.{suffix}")
    found = foreign.read_arrays(tmp_path / "bomb.npz", "the depth", ("other", "absent"))
    assert {name: array.size for name, array in found.items()} == {"other": 9}
