"""ADD, MERGE, REPLACE, DISCARD: decisions on records, and what the bank makes of them."""

import random
import time
from collections.abc import Callable
from typing import Any

import pytest

from gvla2.memory.contracts import Lesson, MemoryTask, RecordType
from gvla2.memory.curation.consolidation import consolidate, evidence, stronger
from gvla2.memory.records import Record, dedup_key, dump
from gvla2.memory.retrieval.hashing import HashEmbedder

Open = Callable[..., Any]


def record(
    content: str,
    *,
    type: RecordType = "procedural_hint",
    skill: str = "",
    effect: dict[str, Any] | None = None,
    count: int = 1,
    quality: float = 0.95,
    updated: float = 1.0,
    query: str = "do it",
) -> Record:
    key = dedup_key(type, content, skill, effect)
    return Record(
        id=f"r-{key[:8]}", bank="b", query=query, content=content, type=type, state="active",
        outcome="verified_success", confidence=0.9, quality=quality, dedup_key=key, created=1.0, updated=updated,
        count=count, skill=skill, effect=dump(effect) if effect else "",
    )  # fmt: skip


def decide(candidate: Record, *rivals: Record) -> Any:
    vectors = HashEmbedder().embed([r.content for r in (candidate, *rivals)])
    near = sorted(zip(rivals, (vectors[1:] @ vectors[0]).tolist(), strict=True), key=lambda p: -p[1])
    return consolidate(candidate, near)


def test_what_is_like_nothing_is_added() -> None:
    assert decide(record("Keep the wrist level while pouring.", query="pour")).action == "ADD"
    assert (
        decide(record("Keep the wrist level.", query="pour"), record("Salt the soup.", query="cook")).action
        == "ADD"
    )


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Grip the mug by its handle near the top.", "Grip the mug by the handle near its top."),
        ("Always lift the crate slowly with both hands.", "Lift the crate slowly, with both hands!"),
        ("Lift the crate 15 cm before turning.", "Lift the crate 150 mm before turning."),
        ("Lift the crate 20 cm.", "Lift the crate 0.2 m."),
        ("Preheat the pan before adding oil.", "Add oil only after the pan has been preheated."),
    ],
)
def test_the_same_in_other_words_is_one_lesson(first: str, second: str) -> None:
    edit = decide(record(first), record(second))
    assert edit.action in ("MERGE", "DISCARD")
    assert edit.scores


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (record("Pick up the small box: grip it deep.", skill="pick"),
         record("Pick up the small box: grip it deep.", skill="push")),
        (record("Grip the red cup by its rim."), record("Grip the red mug lid by its rim.")),
        (record("Pick up the red cube: way 1."), record("Pick up the red cube: way 2.")),
        (record("The handle needs room.", effect={"kind": "prior", "parameter": "depth", "value": 1.0}),
         record("The handle needs room.", effect={"kind": "prior", "parameter": "tilt", "value": 1.0})),
        (record("Turn the knob of lamp A slowly."), record("Turn the knob of lamp B slowly.")),
        (record("Grip the cup."), record("Grip the cup.", type="failure_avoidance")),
        (record("Wipe the screw with a dry cloth before packing."),
         record("Wipe the screen with a dry cloth before packing.")),
        (record("Put bolt M6x20 into bin A3."), record("Put bolt M6x25 into bin A3.")),
        (record("Use cable USB-A for the scanner."), record("Use cable USB-C for the scanner.")),
        (record("Rebase the topic branch before merging it."), record("Merge the topic branch before rebasing it.")),
        (record("Wait for the oven to reach 180 °C."), record("Wait for the oven to reach 200 °C.")),
    ],
)  # fmt: skip
def test_other_skills_objects_parameters_and_numbers_are_never_merged(first: Record, second: Record) -> None:
    assert decide(first, second).action not in ("MERGE", "DISCARD")


def test_a_contradiction_is_settled_by_evidence() -> None:
    new, old = record("Lift the cup 5 cm.", updated=2.0), record("Lift the cup 15 cm.")
    assert decide(new, old).action == "REPLACE"  # as much evidence, and later
    often = record("Lift the cup 15 cm.", count=4)
    edit = decide(new, often)
    assert (edit.action, edit.target) == ("DISCARD", often.id)
    assert edit.conflicts[0][0] == often.id
    assert evidence(often) > evidence(new)
    assert stronger(often, new)
    assert not stronger(new, often)


def test_a_constraint_and_a_hint_that_contradict_each_other_both_stay() -> None:
    edit = decide(
        record("Grip the cup by its rim."), record("Never grip the cup by its rim.", type="failure_avoidance")
    )
    assert edit.action == "ADD"
    assert edit.conflicts


def test_one_sentence_of_a_long_lesson_is_compared() -> None:
    long = record(
        "Stale objects break the link step on this machine. Run `make clean` before `make install`, and check it.",
        query="fix the build",
    )
    other = record(
        "The headers are made anew each night by another job. Run `make install` before `make clean`, always.",
        query="the build fails, please fix it",
    )
    edit = decide(long, other)
    assert (edit.action, edit.target) == ("REPLACE", other.id)
    assert "first" in edit.conflicts[0][1]
    elsewhere = record(other.content.replace("install", "lint"), query="fix the build")
    assert decide(long, elsewhere).action == "ADD"


def test_what_is_right_for_another_task_is_no_contradiction() -> None:
    first = record("Slide the bolt up.", query="open the hatch")
    assert decide(record("Slide the bolt down.", query="close the hatch"), first).action == "ADD"
    assert decide(record("Slide the bolt down.", query="please open the hatch"), first).action == "REPLACE"


def test_the_same_inputs_give_the_same_decision() -> None:
    rivals = [record(f"Lift the cup {n} cm.", count=n) for n in (1, 2, 15, 30)]
    edits = {repr(decide(record("Lift the cup 5 cm."), *order)) for order in (rivals, rivals[::-1])}
    assert len(edits) == 1


def test_the_bank_keeps_links_to_both_and_archives_the_loser(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    (old,) = bank.admit(
        Lesson("procedural_hint", "Lift the cup 15 cm."), verdicts["success"], task="cup", trusted=True
    ).added
    learned = bank.admit(
        Lesson("procedural_hint", "Lift the cup 5 cm."), verdicts["success"], task="cup", trusted=True
    )
    (new,) = learned.added
    assert {r.id: r.state for r in bank.records()} == {old: "archive", new: "active"}
    assert {(k.source, k.kind, k.target) for k in bank.links()} == {
        (new, "conflict", old),
        (new, "replaces", old),
    }
    assert [k.kind for k in bank.conflicts()] == ["conflict"]
    assert any(old in note for note in learned.notes)
    # The loser is found again when it is said again, and comes back once it has more behind it.
    first = bank.admit(
        Lesson("procedural_hint", "Lift the cup 15 cm."), verdicts["success"], task="cup", trusted=True
    )
    assert first.merged == (old,)
    assert {r.id: r.state for r in bank.records()} == {old: "active", new: "archive"}
    assert bank.verify() == []


def test_a_merge_pools_evidence_and_keeps_the_other_wording(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    first = Lesson("procedural_hint", "Grip the mug by its handle near the top.")
    other = Lesson("procedural_hint", "Near the top, grip the mug by the handle.")
    (kept,) = bank.admit(first, verdicts["success"], task="take the mug", trusted=True).added
    assert bank.admit(other, verdicts["success"], task="fetch the mug", trusted=True).merged == (kept,)
    assert bank.admit(other, verdicts["success"], task="bring the mug", trusted=True).merged == (kept,)
    (active,) = bank.records(["active"])
    (folded,) = bank.records(["archive"])
    assert active.count == 3
    assert active.query.split("\n") == ["take the mug", "fetch the mug", "bring the mug"]
    assert [(k.source, k.kind, k.target) for k in bank.links()] == [(kept, "merged", folded.id)]


def test_an_unverified_repeat_of_a_loser_changes_nothing(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    bank.admit(
        Lesson("procedural_hint", "Lift the cup 15 cm."), verdicts["success"], task="cup", trusted=True
    )
    bank.admit(Lesson("procedural_hint", "Lift the cup 5 cm."), verdicts["success"], task="cup", trusted=True)
    before = bank.records()
    assert bank.admit(
        Lesson("procedural_hint", "Lift the cup 15 cm."), verdicts["unavailable"], task="cup", trusted=True
    ).discarded
    assert [r.state for r in bank.records()] == [r.state for r in before]


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
        bank.admit(
            lesson,
            verdicts["fail"],
            task=f"move the jar, {cause.split()[-1]}",
            source=f"run/{i}",
            trusted=True,
        )
    for cause in causes:
        items = bank.recall(MemoryTask(f"move the jar, {cause}")).items
        assert any(cause in item.content and item.binding for item in items)


def test_one_candidate_among_many_takes_little_time(
    open_bank: Open, verdicts: Any, many_lessons: Any
) -> None:
    bank = open_bank()
    bank.admit_many(
        [(lesson, verdicts["success"], task, "") for lesson, task in many_lessons(300)], trusted=True
    )
    rng = random.Random(5)
    times = []
    for lesson, task in many_lessons(20, seed=rng.randrange(10**6)):
        began = time.perf_counter()
        bank.admit(lesson, verdicts["success"], task=task, trusted=True)
        times.append(time.perf_counter() - began)
    assert sorted(times)[len(times) // 2] < 0.1  # the figure for an idle machine is in tests/benchmarks
