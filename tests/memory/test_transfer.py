"""JSON lines out and in: nothing of a file becomes active by itself, and one's own lessons come back."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import MemoryStoreError, OutputError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson
from gvla2.memory.transfer import export_jsonl, import_jsonl

Open = Callable[..., KnowledgeBank]
BOUND = {"kind": "bound", "parameter": "lift", "op": ">=", "value": 0.15}


@pytest.fixture
def file(open_bank: Open, verdicts: Any, tmp_path: Path) -> Path:
    """An export of five records: two active ones of ours, two provisional, one archived."""
    bank = open_bank("first", governance=True)
    low = Lesson("procedural_hint", "Lift it at most 5 cm.", {**BOUND, "op": "<=", "value": 0.05})
    bank.admit(low, verdicts["success"], task="lift the cup", trusted=True)
    bank.admit(Lesson(low.type, "Lift it at least 15 cm.", BOUND), verdicts["success"], task="lift the cup",
               trusted=True)  # fmt: skip
    bank.admit(Lesson("failure_avoidance", "Never pull the cord."), verdicts["fail"], task="unplug it",
               trusted=True)  # fmt: skip
    bank.admit("Wring the cloth out.", verdicts["success"], task="wipe the table", source="club")
    bank.admit("Swing fast.", verdicts["success"], task="open the drawer", source="lab")
    assert export_jsonl(bank.store, "first", tmp_path / "out.jsonl") == 5
    return tmp_path / "out.jsonl"


def test_of_ones_own_export_ones_own_active_lessons_become_active(open_bank: Open, file: Path) -> None:
    bank = open_bank("second")
    done = import_jsonl(bank, file, trusted=True)
    assert (len(done.added), len(done.held_back), done.left_out, done.broken) == (2, 2, 1, ())
    active = {record.content: record for record in bank.records(["active"])}
    assert set(active) == {"Lift it at least 15 cm.", "Never pull the cord."}
    assert active["Lift it at least 15 cm."].effect_json() == BOUND
    again = import_jsonl(bank, file, trusted=True)
    assert (again.added, again.held_back) == ((), ())
    assert len(bank.records()) == 4
    assert bank.verify() == []


def test_whatever_a_file_says_it_waits(open_bank: Open, file: Path) -> None:
    bank = open_bank("second")
    assert import_jsonl(bank, file).added == ()
    assert {record.state for record in bank.records()} == {"provisional"}
    assert not bank.recall("lift the cup").items


def test_broken_lines_are_named_and_the_others_read(open_bank: Open, tmp_path: Path) -> None:
    good = {"content": "Hold the rim.", "outcome": "verified_success", "quality": 1.0, "confidence": 1.0}
    odd = [b"nonsense", b"[1]", b"\xff", b"{}", json.dumps({**good, "type": "spell"}).encode()]
    odd += [json.dumps({**good, "effect": {"value": 1e300}}).encode(), b'{"content": "x", "quality": NaN}']
    odd += [
        json.dumps({**good, **wrong}).encode()
        for wrong in (
            *({"skill": "\ud800"}, {"type": ["spell"]}),
            *({"quality": 7}, {"confidence": -1}, {"query": ["lift", "push"]}),
        )
    ]
    path = tmp_path / "in.jsonl"
    path.write_bytes(b"\n".join([json.dumps(good).encode(), *odd]))
    done = import_jsonl(open_bank(), path)
    assert len(done.held_back) == 1
    assert [line.partition(":")[0] for line in done.broken] == [f"in.jsonl, line {i}" for i in range(2, 14)]
    path.write_bytes(b"nonsense")
    with pytest.raises(MemoryStoreError, match="not an export"):
        import_jsonl(open_bank(), path)
    with pytest.raises(MemoryStoreError, match="Cannot read"):
        import_jsonl(open_bank(), tmp_path / "nowhere")


def test_an_export_replaces_nothing(open_bank: Open, file: Path) -> None:
    with pytest.raises(OutputError, match="never replaces"):
        export_jsonl(open_bank("first").store, "first", file)
