"""ADD, MERGE, REPLACE, DISCARD: decisions on records, and what the bank makes of them."""

from collections.abc import Callable
from typing import Any

import pytest

from gvla2.memory.contracts import Lesson, MemoryTask, RecordType
from gvla2.memory.curation.contesting import consolidate
from gvla2.memory.curation.evidence import evidence, standing
from gvla2.memory.records import Record, dedup_key, dump
from tests.memory.looking import look

Open = Callable[..., Any]


def record(
    content: str,
    *,
    type: RecordType = "procedural_hint",
    skill: str = "",
    effect: dict[str, Any] | None = None,
    query: str = "do it",
    **fields: Any,
) -> Record:
    key = dedup_key(type, content, skill, effect)
    told: dict[str, Any] = {
        "id": f"r-{key[:8]}", "bank": "b", "query": query, "content": content, "type": type, "state": "active",
        "outcome": "verified_success", "confidence": 0.9, "quality": 0.95, "dedup_key": key, "created": 1.0,
        "updated": 1.0, "skill": skill, "effect": dump(effect) if effect else "",
    }  # fmt: skip
    return Record(**{**told, **fields})


def bound(value: float, op: str = ">=", **more: Any) -> dict[str, Any]:
    return {"kind": "bound", "parameter": "lift_height", "op": op, "value": value, **more}


def decide(candidate: Record, *rivals: Record) -> Any:
    return consolidate(candidate, [(rival, 0.8) for rival in rivals])


def test_what_is_like_nothing_is_added() -> None:
    assert decide(record("Keep the wrist level while pouring.", query="pour")).action == "ADD"
    edit = decide(record("Keep the wrist level.", query="pour"), record("Salt the soup.", query="cook"))
    assert (edit.action, edit.suspected) == ("ADD", ())


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Grip the mug by its handle near the top.", "Grip the mug by the handle near its top."),
        ("Always lift the crate slowly with both hands.", "Lift the crate slowly, with both hands!"),
        ("Lift the crate 15 cm before turning.", "Lift the crate 150 mm before turning."),
    ],
)
def test_the_same_in_other_words_is_one_lesson(first: str, second: str) -> None:
    edit = decide(record(first), record(second))
    assert (edit.action, edit.target) == ("MERGE", record(second).id)
    far = consolidate(record(first), [(record(second), 0.1)])
    assert far.action == "ADD"


def test_contradicting_effects_are_settled_by_evidence() -> None:
    low, high = bound(0.05, "<="), bound(0.15)
    new, old = record("At most 5 cm.", effect=low, updated=2.0), record("At least 15 cm.", effect=high)
    assert decide(new, old).action == "REPLACE"  # as much evidence, and later
    often = record("At least 15 cm.", effect=high, count=4)
    edit = decide(new, often)
    assert (edit.action, edit.target) == ("DISCARD", often.id)
    assert edit.conflicts[0][0] == often.id
    assert evidence(often) > evidence(new)
    assert standing(often) < standing(new)
    assert decide(record("At most 5 cm.", effect=low, trust="confirmed"), old).action == "DISCARD"
    assert decide(new, record("At least 15 cm.", effect=high, count=4, trust="confirmed")).action == "REPLACE"


def test_texts_that_may_contradict_each_other_both_stay() -> None:
    first = record("Open the lid before pouring.", query="pour the tea")
    second = record("Close the lid before pouring.", query="pour the tea")
    edit = decide(first, second)
    assert (edit.action, edit.conflicts) == ("ADD", ())
    assert [id for id, _ in edit.suspected] == [second.id]


def test_programs_never_contradict_each_other_nor_merge() -> None:
    one, two = (
        record(
            "This program put the cup into the box.",
            effect={
                "kind": "program",
                "skill": "place",
                "language": "calls",
                "roles": {"theme": "cup"},
                "steps": [s],
            },
        )
        for s in ("place({theme}, {goal}, in)", "push({theme}, left)")
    )
    assert one.id != two.id
    edit = decide(one, two)
    assert (edit.action, edit.conflicts, edit.suspected) == ("ADD", (), ())


def test_the_same_inputs_give_the_same_decision() -> None:
    rivals = [record(f"At least {n} cm.", effect=bound(n / 100), count=n) for n in (1, 2, 15, 30)]
    candidate = record("At most 5 cm.", effect=bound(0.05, "<="))
    assert len({repr(decide(candidate, *order)) for order in (rivals, rivals[::-1])}) == 1


def test_the_bank_keeps_links_to_both_and_archives_the_loser(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    at_least = Lesson("procedural_hint", "Lift it at least 15 cm.", bound(0.15))
    at_most = Lesson("procedural_hint", "Lift it at most 5 cm.", bound(0.05, "<="))
    (old,) = bank.admit(at_least, verdicts["success"], task="cup", trusted=True).added
    learned = bank.admit(at_most, verdicts["success"], task="cup", trusted=True)
    (new,) = learned.added
    assert {r.id: r.state for r in bank.records()} == {old: "archive", new: "active"}
    links = {(k.source, k.kind, k.target) for k in look(bank.store, bank.bank).links()}
    assert links == {(new, "conflict", old), (new, "replaces", old)}
    assert any(old in note for note in learned.notes)
    # The loser is found again when it is said again, and comes back once it has more behind it.
    assert bank.admit(at_least, verdicts["success"], task="cup", trusted=True).merged == (old,)
    assert {r.id: r.state for r in bank.records()} == {old: "active", new: "archive"}
    assert bank.admit(at_most, verdicts["unavailable"], task="cup").discarded
    assert {r.id: r.state for r in bank.records()} == {old: "active", new: "archive"}
    assert bank.verify() == []


def test_a_suspicion_archives_nothing_and_lowers_both(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    for text in ("Open the lid before pouring the tea.", "Close the lid before pouring the tea."):
        bank.admit(text, verdicts["success"], task="pour the tea", trusted=True)
    assert [r.state for r in bank.records()] == ["active", "active"]
    assert [k.kind for k in look(bank.store, bank.bank).links()] == ["suspicion"]
    assert all(hit.terms["conflict"] < 0 for hit in bank.search("pour the tea"))


def test_a_merge_pools_evidence_and_keeps_the_other_wording(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    first, other = "Grip the mug by its handle near the top.", "Near the top, grip the mug by the handle."
    (kept,) = bank.admit(first, verdicts["success"], task="take the mug", trusted=True).added
    assert bank.admit(other, verdicts["success"], task="fetch the mug", trusted=True).merged == (kept,)
    assert bank.admit(other, verdicts["success"], task="bring the mug", trusted=True).merged == (kept,)
    (active,) = bank.records(["active"])
    (folded,) = bank.records(["archive"])
    assert active.count == 3
    assert active.query.split("\n") == ["take the mug", "fetch the mug", "bring the mug"]
    assert [(k.source, k.kind, k.target) for k in look(bank.store, bank.bank).links()] == [
        (kept, "merged", folded.id)
    ]


def test_each_failure_is_found_on_its_own(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    causes = (
        "it slipped out of the fingers",
        "the arm hit the lamp",
        "the lid was stuck",
        "the cable was too short",
    )
    for i, cause in enumerate(causes):
        lesson = Lesson("failure_avoidance", f"Moving the jar {i}: failed because {cause}.")
        task = f"move the jar, {cause.split()[-1]}"
        bank.admit(lesson, verdicts["fail"], task=task, source=f"run/{i}", trusted=True)
    for cause in causes:
        items = bank.recall(MemoryTask(f"move the jar, {cause}")).items
        assert any(cause in item.content and item.binding for item in items)
