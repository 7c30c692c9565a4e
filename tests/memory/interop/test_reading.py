"""Foreign lines with numbers beyond all bounds, and memories that come through a pipe."""

import json
import os
import threading
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.interop.importing import import_path, read_path
from gvla2.memory.storage.store import Store
from tests.memory.looking import look

GOOD = {"memory_id": "good", "content": "Hold the rim.", "state": "active", "source_status": "success"}
HUGE = ["1" + "0" * 400, "-1" + "0" * 400, "1e999", "-1e999", "9" * 250 + "e99"]


@pytest.mark.parametrize("number", HUGE, ids=lambda n: n[:9])
@pytest.mark.parametrize("name", ["use_count", "quality_score", "confidence", "created_at", "lab"])
def test_odd_numbers_stop_nothing(tmp_path: Path, name: str, number: str):
    file = tmp_path / "active.jsonl"
    odd = json.dumps(GOOD | {"memory_id": "odd", "content": "Hold it."})[:-1] + f', "{name}": {number}}}'
    file.write_text(f"{odd}\n{json.dumps(GOOD)}\n")
    with Store.open(tmp_path / "m.db") as store:
        assert len(import_path(store, "b", file, now=1.8e9).added) == 2
        assert look(store, "b").verify() == []


@pytest.mark.skipif(os.name != "posix", reason="pipes with names are POSIX's")
def test_a_memory_comes_through_a_pipe(tmp_path: Path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    feeding = threading.Thread(target=pipe.write_text, args=(json.dumps(GOOD) + "\nnonsense\n",))
    feeding.start()
    lines, remarks = read_path(pipe)
    feeding.join()
    assert ([fields["memory_id"] for _, _, fields in lines], [remark.line for remark in remarks]) == (
        ["good"],
        [2],
    )
    assert read_path(Path("/dev/null")) == ([], [])


def test_a_file_of_nonsense_is_no_empty_memory(tmp_path: Path):
    (tmp_path / "m.jsonl").write_text("nonsense\n")
    with pytest.raises(MemoryStoreError, match="is not a memory"):
        read_path(tmp_path / "m.jsonl")


def test_a_name_that_no_file_system_takes(tmp_path: Path):
    with pytest.raises(MemoryStoreError, match="There is nothing at"):
        read_path(tmp_path / ("x" * 5000))
