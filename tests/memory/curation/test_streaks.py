"""Streaks among processes: each counts on from the last judgement, whatever else happened to the records since."""

from collections.abc import Callable
from typing import Any

import pytest

from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict

Open = Callable[..., Any]
YES = Verdict.from_criteria({"completion": 1.0, "safety": 1.0}, verifier="yes")
NO = Verdict.from_criteria({"completion": 0.0, "safety": 0.2}, verifier="yes")
OTHER = Verdict.from_criteria({"completion": 0.9}, verifier="other")
TREES = ("ash", "birch", "cedar", "elm", "fir", "holly", "larch", "maple", "oak", "pine")


def says(bank: Any, tree: str, verdict: Verdict = YES) -> int:
    """The streak that the record of one more lesson has."""
    learned = bank.admit(Lesson("tool_usage", f"{tree * 3} needs {tree * 2}"), verdict, task=tree)
    ids = {*learned.added, *learned.provisional}
    (record,) = [record for record in bank.records() if record.id in ids]
    return int(record.verifier_json().get("streak", {}).get("length", 0))


def credit(bank: Any, task: str, source: str) -> None:
    recalled = bank.recall(task)
    assert recalled.items
    bank.learn(MemoryEpisode(MemoryTask("another"), (), source=source, recalled=recalled), OTHER)


def test_a_credit_in_another_process_does_not_set_a_streak_back(open_bank: Open) -> None:
    here, there = open_bank(), open_bank()
    lengths = []
    for i, tree in enumerate(TREES):
        lengths.append(says(here, tree))
        if i % 3 == 2:
            credit(there, f"{TREES[0]} {TREES[0] * 3}", f"run/{i}")
    assert lengths == list(range(1, len(TREES) + 1))


def test_nor_for_a_process_that_begins(open_bank: Open) -> None:
    for i, tree in enumerate(TREES[:4]):
        assert says(open_bank(), tree) == i + 1
    credit(open_bank(), f"{TREES[0]} {TREES[0] * 3}", "run/1")
    assert says(open_bank(), TREES[5]) == 5


def test_processes_count_on_from_one_another(open_bank: Open) -> None:
    banks = [open_bank(), open_bank()]
    assert [says(banks[i % 2], tree) for i, tree in enumerate(TREES[:6])] == [1, 2, 3, 4, 5, 6]


def test_the_last_of_one_transaction_counts(open_bank: Open) -> None:
    here, there = open_bank(), open_bank()
    assert says(here, "yew") == 1
    items = [(Lesson("tool_usage", f"{t * 3} needs {t * 2}"), YES, t, f"run/{t}") for t in TREES]
    there.admit_many(items)
    assert says(here, "willow") == len(TREES) + 2


@pytest.mark.parametrize("begins", [False, True])
def test_another_judgement_ends_a_streak_everywhere(open_bank: Open, begins: bool) -> None:
    here, there = open_bank(), open_bank()
    assert [says(here, tree) for tree in TREES[:3]] == [1, 2, 3]
    failed = Lesson("failure_avoidance", "Never bend the willow.")
    assert there.admit(failed, NO, task="willow").added
    credit(there, f"{TREES[2]} {TREES[2] * 3}", "run/1")
    assert says(open_bank() if begins else here, "oak") == 1


def test_a_row_that_was_repaired_brings_no_old_streak(open_bank: Open) -> None:
    here, there = open_bank(), open_bank()
    assert [says(here, tree) for tree in TREES[:4]] == [1, 2, 3, 4]
    (first,) = [record for record in there.records() if TREES[0] in record.content]
    with there._store._database.writing("default") as raw:
        assert raw.run("DELETE FROM memory WHERE id = ?", (first.id,))
    with there._store.writing("default", actor="test", now=1.9e9) as tx:
        assert tx.repair().records == (first.id,)
    assert says(here, "oak") == 5


@pytest.mark.parametrize("change", ["{", '{"verifier":["{}",7]}', '{"verifier":"[]"}', "[]"])
def test_a_damaged_event_holds_up_nothing(open_bank: Open, change: str) -> None:
    here, there = open_bank(), open_bank()
    assert [says(here, tree) for tree in TREES[:3]] == [1, 2, 3]
    with there._store._database.writing("default") as raw:
        assert raw.run("UPDATE memory_event SET change = ? WHERE action = 'ADD' AND rev = 3", (change,))
    assert says(there, "oak") == 3  # what came before it is all that can be known
