import logging
from pathlib import Path

import numpy as np
import pytest

from gvla2.io.array_cache import cache_folder, cached_arrays


def test_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
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
def test_made_once_for_a_key_and_again_where_it_is_damaged(
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
    assert cached_arrays(tmp_path / "kept", "a", make)["count"] == 3


def test_a_folder_that_cannot_be_written_only_costs_time(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "occupied").write_text("a file")
    make = Maker()
    with caplog.at_level(logging.WARNING):
        for count in (1, 2):
            assert cached_arrays(tmp_path / "occupied", "a", make)["count"] == count
    assert "could not be cached" in caplog.text
