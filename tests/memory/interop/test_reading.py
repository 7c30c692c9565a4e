"""Foreign lines with numbers beyond all bounds, and memories that come through a pipe."""

import json
import os
import threading
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.interop import lines, states_layout, vocabulary
from gvla2.memory.interop.importing import import_path
from gvla2.memory.interop.lines import Line, LineError, parse, read_lines
from gvla2.memory.interop.reading import read_path
from gvla2.memory.storage.store import Store

GOOD = {"memory_id": "good", "content": "Hold the rim.", "state": "active", "source_status": "success"}
HUGE = ["1" + "0" * 400, "-1" + "0" * 400, "9" * 5000, "1e999", "-1e999", "1E+400", "9" * 250 + "e99"]


def odd(name: str, number: str) -> str:
    return json.dumps(GOOD | {"memory_id": "odd"})[:-1] + f', "{name}": {number}}}'


@pytest.mark.parametrize("number", HUGE, ids=lambda n: n[:9])
@pytest.mark.parametrize(
    "name", ["use_count", "quality_score", "confidence", "created_at", "last_used_at", "lab"]
)
def test_one_odd_number_is_one_broken_line(tmp_path: Path, name: str, number: str):
    file = tmp_path / "active.jsonl"
    file.write_text(f"{odd(name, number)}\n{json.dumps(GOOD)}\n")
    with Store.open(f"sqlite:///{tmp_path / 'm.db'}") as store:
        done = import_path(store, "b", file, now=1.8e9)
        assert len(done.added) == 1
    (remark,) = done.broken
    assert remark.line == 1
    assert "too large a number" in remark.why
    assert len(str(remark)) < 120


@pytest.mark.parametrize("name", ["memory_items", "memory_text"])
def test_the_other_layouts_too(tmp_path: Path, name: str):
    row = {name: "Hold the rim.", "task_text": "lift", "task_id": "t"}
    text = json.dumps(row)
    (tmp_path / "m.jsonl").write_text(f'{text[:-1]}, "steps": [{{"n": 1e999}}]}}\n{text}\n')
    _, entries, remarks = read_path(tmp_path / "m.jsonl")
    assert (len(entries), [remark.line for remark in remarks]) == (1, [1])


def test_large_numbers_that_are_numbers_stay_what_they_are():
    digits = "123456789" * 30
    assert parse(f'{{"a": 1e300, "b": {digits}, "c": "{digits * 3}", "d": 1.5e-400}}') == {
        "a": 1e300, "b": int(digits), "c": digits * 3, "d": 0.0,
    }  # fmt: skip
    with pytest.raises(LineError, match="too large"):
        parse('{"deep": [{"x": 1e400}]}')


@pytest.mark.parametrize(
    "value", [10**400, -(10**400), float("inf"), float("nan"), 1e300, True, None, "7", []]
)
def test_numbers_of_callers_from_elsewhere(value: object):
    assert vocabulary.share(value) in (None, 1.0)
    assert 0 <= vocabulary.count(value) <= 2**53
    assert vocabulary.seconds_of(value) is None
    assert set(vocabulary.numbers({"x": value})) <= ({"x"} if value == 1e300 else set())
    fields = GOOD | dict.fromkeys(("use_count", "quality_score", "confidence", "created_at"), 1e300)
    (entry,) = states_layout.read(Line("active.jsonl", 1, fields))
    assert (entry.quality, entry.confidence, entry.created) == (1.0, 1.0, None)


def test_a_line_without_an_end_is_not_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(lines, "LONGEST_LINE", 100)
    file = tmp_path / "m.jsonl"
    file.write_text('{"a": 1}\n' + "x" * 1000 + '\n{"b": 2}\n')
    found, (remark,) = read_lines(file)
    assert [(line.number, dict(line.fields)) for line in found] == [(1, {"a": 1}), (3, {"b": 2})]
    assert (remark.line, "longer than 100 bytes" in remark.why) == (2, True)
    with file.open("rb") as stream:
        assert max(len(raw) for _, raw in lines.raw_lines(stream)) <= 101


@pytest.mark.skipif(os.name != "posix", reason="pipes with names are POSIX's")
def test_a_memory_comes_through_a_pipe(tmp_path: Path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    feeding = threading.Thread(target=pipe.write_text, args=(json.dumps(GOOD) + "\nnonsense\n",))
    feeding.start()
    _, entries, remarks = read_path(pipe)
    feeding.join()
    assert ([entry.key for entry in entries], [remark.line for remark in remarks]) == (["good"], [2])
    assert read_path(Path("/dev/null"))[1:] == ([], [])


def test_a_file_of_nonsense_is_no_empty_memory(tmp_path: Path):
    (tmp_path / "m.jsonl").write_text("nonsense\n")
    with pytest.raises(MemoryStoreError, match="no known layout"):
        read_path(tmp_path / "m.jsonl")


def test_a_name_that_no_file_system_takes(tmp_path: Path):
    with pytest.raises(MemoryStoreError, match="There is nothing at"):
        read_path(tmp_path / ("x" * 5000))
