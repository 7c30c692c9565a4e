import json
import os
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import OutputError
from gvla2.io.files import plain, write_json, write_text


class Colour(Enum):
    RED = "red"


@dataclass
class Pair:
    a: float
    b: np.ndarray


def test_json_takes_what_numpy_gives(tmp_path: Path) -> None:
    value = {
        "f32": np.float32(0.5),
        "i": np.int64(3),
        "flag": np.bool_(True),
        "rows": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        3: {2, 1},
        "pair": Pair(float("-inf"), np.zeros(2)),
        "enum": Colour.RED,
        "path": Path("x"),
        "bytes": b"\x01",
    }
    read = json.loads(write_json(tmp_path / "a.json", value).read_text(encoding="utf-8"))
    assert read == {
        "f32": 0.5,
        "i": 3,
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
    assert json.loads(write_json(tmp_path / "a.json", "\udce9").read_text(encoding="utf-8")) == "\udce9"


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_interrupted_write_keeps_the_old_file(
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


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file stands where the folder should be")
    with pytest.raises(OutputError, match=r"runs.*hydra\.run\.dir"):
        write_text(tmp_path / "runs" / "result.json", "x")
