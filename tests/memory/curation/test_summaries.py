"""Summaries keep the numbers, say when they held, and grow: many near-copies end as one or a few records."""

import random
import re
from collections.abc import Callable
from typing import Any

import pytest

from gvla2.memory.contracts import ConsolidationEdit, Lesson
from gvla2.memory.curation.governance import Governed
from gvla2.memory.curation.rewriting import rewrite
from tests.memory.looking import look

Open = Callable[..., Any]


def near_copies(count: int, how: str) -> list[tuple[str, str]]:
    """(text, task) of many near-copies of one lesson, as agents that say it in their own words write them."""
    rng = random.Random(4)
    said = []
    for i in range(count):
        cup = rng.choice(["cup", "mug", "glass", "beaker"])
        number = rng.randint(12, 18)
        texts = {
            "numbers": f"Lift the cup {number} cm before you move it sideways.",
            "counters": f"Lift the cup high before you move it sideways (run {i}).",
            "objects": f"Lift the {cup} {number} cm before you move it sideways.",
            "words": f"{rng.choice(['Lift', 'Raise'])} the cup {rng.choice(['well', 'far', 'straight up', 'first'])} "
            f"before you {rng.choice(['move', 'carry', 'shift'])} it {rng.choice(['sideways', 'away', 'to the box'])}.",
        }
        said.append((texts[how], f"put the {cup} away"))
    return said


@pytest.mark.parametrize("how", ["numbers", "counters", "objects", "words"])
def test_many_near_copies_end_as_a_few_records(open_bank: Open, verdicts: Any, how: str) -> None:
    bank, count = open_bank(), 800 if how == "counters" else 300
    items = [
        (Lesson("procedural_hint", text), verdicts["success"], task, f"run/{i}")
        for i, (text, task) in enumerate(near_copies(count, how))
    ]
    for start in range(0, count, 50):
        bank.admit_many(items[start : start + 50], trusted=True)
    bank.govern()
    served = bank.records(["active", "summary"])
    # Eight hundred different numbers are listed in eleven summaries; none of them is left out.
    assert 1 <= len(served) <= (16 if how == "counters" else 8)
    if how == "counters":
        told = " ".join(record.content for record in served)
        assert {str(i) for i in range(800)} <= set(re.findall(r"\d+", told))
    assert sum(record.count for record in served) == count
    assert (
        len([link for link in look(bank.store, bank.bank).links() if link.kind in ("suspicion", "conflict")])
        <= 40
    )
    assert bank.recall("put the cup away").items
    assert bank.verify() == []
    if how == "numbers":
        (summary,) = served
        assert all(str(number) in summary.content for number in range(12, 19))


def test_a_summary_says_which_number_held_when(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    for number, task in ((15, "put the mug away"), (12, "stack the cups"), (20, "clear the tall vase")):
        text = f"Lift it {number} cm before moving sideways, then wait 2 s."
        bank.admit(text, verdicts["success"], task=task, source=task, trusted=True)
    (summary,) = bank.records(["summary"])
    said = (
        "12 (stack the cups) or 15 (put the mug away) or 20 (clear the tall vase) cm before moving sideways"
    )
    assert said in summary.content
    assert "then wait 2 s" in summary.content
    assert summary.count == 3
    bank.admit("Lift it 30 cm before moving sideways, then wait 2 s.", verdicts["success"], task="move the lamp",
               source="later", trusted=True)  # fmt: skip
    (grown,) = bank.records(["summary"])
    assert grown.id == summary.id
    assert f"{said.split(' cm')[0]} or 30 (move the lamp) cm before moving sideways" in grown.content
    assert grown.count == 4
    assert len(look(bank.store, bank.bank).links()) == 4
    assert bank.verify() == []


def test_a_summary_is_trusted_no_more_than_what_it_tells(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    for i, number in enumerate((15, 12, 20)):
        text = f"Lift it {number} cm before moving sideways."
        for source in ("lab", "friend") if i == 1 else (f"run/{i}",):
            bank.admit(text, verdicts["success"], task=f"task {i}", source=source, trusted=i != 1)
    (summary,) = bank.records(["summary"])
    assert summary.trust == "confirmed"


def test_what_may_contradict_is_not_summed_up(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    for i, side in enumerate(("left", "right", "left", "right")):
        text = f"Turn the lid to the {side} until the mark on it is seen."
        bank.admit(text, verdicts["success"], task=f"open the jar {i % 2}", source=f"run/{i}", trusted=True)
    bank.govern()
    assert not bank.records(["summary"])


def test_forgetting_a_member_brings_the_others_back(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    for i, number in enumerate((15, 12, 20)):
        bank.admit(
            f"Lift it {number} cm.", verdicts["success"], task=f"task {i}", source=f"run/{i}", trusted=True
        )
    member = next(record for record in bank.records(["archive"]) if "12" in record.content)
    assert bank.forget(member.id)
    assert sorted(r.content for r in bank.records(["active"])) == ["Lift it 15 cm.", "Lift it 20 cm."]
    assert not [r for r in bank.records() if "12" in r.content]
    assert bank.verify() == []


@pytest.mark.parametrize("hosts", [3, 4, 5, 12, 40])
def test_every_number_can_be_recalled(open_bank: Open, hosts: int) -> None:
    bank = open_bank()
    for i in range(hosts):
        bank.learn(
            f"check the service on host {i}", f"$ probe --port {4000 + 7 * i}", success=True, source=f"r{i}"
        )
    bank.govern()
    told = [record.content for record in bank.records(["active", "summary"])]
    for i in range(hosts):
        assert sum(str(4000 + 7 * i) in text for text in told) == 1
    assert all(
        f"{4000 + 7 * i} (check the service on host {i})" in " ".join(told) for i in range(min(hosts, 5))
    )
    assert len(told) < max(hosts / 3, 2)
    if hosts <= 5:
        (summary,) = bank.records(["summary"])
        assert summary.content in bank.recall("check the service on host 1").text
    assert bank.verify() == []


def test_a_merge_that_cannot_show_all_numbers_is_not_made(open_bank: Open) -> None:
    class Careless:
        """A writer whose merged texts lose the numbers."""

        def consolidate(self, candidate: Any, near: Any) -> ConsolidationEdit:
            return ConsolidationEdit("MERGE", near[0].id, "Use some ports.", "alike")

    bank = open_bank(governance=True)
    for i in range(2):
        ports = ", ".join(str(1000 * (i + 1) + 7 * k) for k in range(60))
        bank.admit(f"Open the ports {ports} of the server.", task=f"serve {i}", trusted=True)
    done = Governed()
    rewrite(bank, Careless(), done)
    assert not done.summed_up
    assert {record.state for record in bank.records()} == {"active"}
