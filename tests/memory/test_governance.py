"""What a bank keeps: retirement, contradictions, summaries, budgets; after each episode and as a whole."""

import random
from collections.abc import Callable
from typing import Any

import pytest

from gvla2.memory.contracts import Lesson, MemoryTask
from gvla2.memory.governance import retention
from gvla2.memory.index import STATES
from gvla2.memory.records import Record
from tests.memory.looking import look

Open = Callable[..., Any]
WAYS = (
    "Read the failing test first, then trace the error to its source file.",
    "Read the failing test first, trace the error to the source file by name.",
    "First read the failing test and trace its error to one source file.",
)


def test_retention_is_the_sum_of_the_released_terms() -> None:
    scores = [
        retention(
            Record(
                id="r", bank="b", query="q", content="c", type="procedural_hint", state="active",
                outcome="verified_success" if verified else "uncertain", confidence=confidence, quality=0.9,
                dedup_key="k", created=0.0, updated=0.0, usage=usage,
            ),
            days * 86400.0,
        )
        for confidence, usage, verified, days in (
            (0.8, 0, True, 90), (0.8, 3, True, 90), (0.8, 50, True, 0), (0.0, 0, False, 90), (0.8, 0, True, 9),
        )
    ]  # fmt: skip
    assert scores == pytest.approx([2.2, 2.5, 2.95, 0.2, 2.35])


def test_stale_failures_that_nobody_used_retire(
    open_bank: Open, episode: Open, verdicts: Any, clock: Any
) -> None:
    bank = open_bank()
    avoid = Lesson("failure_avoidance", "Moving the jar: failed because the lid was loose.")
    used = Lesson("failure_avoidance", "Moving the lamp: failed because the cable was short.")
    bank.learn(episode("Move the jar", avoid, skill=""), verdicts["fail"])
    bank.learn(episode("Move the lamp", used, skill=""), verdicts["fail"])
    recalled = bank.recall(MemoryTask("Move the lamp with the short cable"))
    tool = Lesson("tool_usage", "The crane needs air.")
    bank.learn(episode("Run the crane", tool, skill="", recalled=recalled), verdicts["success"])
    clock.pass_days(13)
    assert bank.govern().changes == 0
    clock.pass_days(2)
    governed = bank.govern()
    assert len(governed.retired) == 1
    (gone,) = bank.records(["archive"])
    assert "jar" in gone.content
    assert "14 days" in gone.note
    assert [e.action for e in look(bank.store, bank.bank).history(gone.id)][-1] == "RETIRE"
    assert bank.govern().changes == 0  # nothing is left to do


def test_learning_retires_as_well(open_bank: Open, episode: Open, verdicts: Any, clock: Any) -> None:
    bank = open_bank()
    avoid = Lesson("failure_avoidance", "Moving the jar: failed because the lid was loose.")
    bank.learn(episode("Move the jar", avoid, skill=""), verdicts["fail"])
    clock.pass_days(20)
    bank.learn(
        episode("Run the crane", Lesson("tool_usage", "The crane needs air."), skill=""), verdicts["success"]
    )
    assert [r.state for r in bank.records() if r.type == "failure_avoidance"] == ["archive"]


@pytest.mark.parametrize("count", [3, 40])
def test_successes_that_differ_in_numbers_only_become_summaries_that_show_each(
    open_bank: Open, count: int
) -> None:
    bank = open_bank()
    for i in range(count):
        task, transcript = f"check the service on host {i}", f"$ probe --port {4000 + 7 * i}"
        bank.learn(task, transcript, success=True, source=f"r{i}")
    bank.govern()
    served = bank.records(["active", "summary"])
    texts = [record.content for record in served]
    for i in range(count):
        assert sum(str(4000 + 7 * i) in text for text in texts) == 1
    assert "4007 (check the service on host 1)" in " ".join(texts)
    assert len(texts) < max(count / 3, 2)
    assert sum(record.count for record in served) == count
    if count == 3:
        (summary,) = bank.records(["summary"])
        assert summary.content in bank.recall("check the service on host 1").text
        again = bank.learn("check the service on host 1", "$ probe --port 4007", success=True, source="later")
        assert again.merged == (summary.id,)
    assert bank.verify() == []


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
    assert bank.verify() == []


def test_a_summary_is_trusted_no_more_than_what_it_tells(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    for i, number in enumerate((15, 12, 20)):
        text = f"Lift it {number} cm before moving sideways."
        for source in ("lab", "friend") if i == 1 else (f"run/{i}",):
            bank.admit(text, verdicts["success"], task=f"task {i}", source=source, trusted=i != 1)
    (summary,) = bank.records(["summary"])
    assert summary.trust == "confirmed"


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


def test_other_words_and_effects_are_not_summed_up(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    for way in WAYS:
        bank.admit(Lesson("procedural_hint", way), verdicts["success"], task="fix the parser", trusted=True)
    for i, name in enumerate(("depth", "tilt", "height")):
        effect = {"kind": "prior", "parameter": name, "value": 1.0, "count": 1}
        content = f"Take the small box: this {name} succeeded."
        bank.admit(
            Lesson("procedural_hint", content, effect),
            verdicts["success"],
            task=f"take box {i}",
            trusted=True,
        )
    assert bank.govern().summaries == []
    assert not bank.records(["summary"])


def test_a_pass_settles_contradicting_effects_that_came_in_unsettled(open_bank: Open, verdicts: Any) -> None:
    lax = open_bank(governance=False)
    for op, value, task in (
        (">=", 0.15, "lift the cup"),
        ("<=", 0.05, "lift the cup"),
        (">=", 0.15, "lift it"),
    ):
        effect = {"kind": "bound", "parameter": "lift_height", "op": op, "value": value}
        lax.admit(
            Lesson("procedural_hint", f"Lift {op} {value}.", effect),
            verdicts["success"],
            task=task,
            trusted=True,
        )
    assert len(lax.records(["active"])) == 2
    bank = open_bank()
    assert len(bank.govern().replaced) == 1
    (kept,) = bank.records(["active"])
    assert kept.content == "Lift >= 0.15."
    assert {k.kind for k in look(bank.store, bank.bank).links()} == {"conflict"}
    assert bank.govern().changes == 0


def test_the_budget_holds_however_much_comes_in(open_bank: Open, verdicts: Any, many_lessons: Any) -> None:
    bank = open_bank(active_budget=40, provisional_budget=15)
    items = [(lesson, verdicts["success"], task, "") for lesson, task in many_lessons(150)]
    items += [(lesson, verdicts["uncertain"], task, "") for lesson, task in many_lessons(60, seed=1)]
    for start in range(0, len(items), 30):
        bank.admit_many(items[start : start + 30], trusted=True)
        assert len(bank.records(["active", "summary"])) <= 40
        assert len(bank.records(["provisional"])) <= 15
        assert sum(map(bank.index.count, STATES)) <= 55  # what is archived takes no room in memory
    assert len(bank.records()) == 210  # nothing was deleted
    assert bank.verify() == []


def test_without_governance_nothing_of_it_happens(open_bank: Open, verdicts: Any, clock: Any) -> None:
    bank = open_bank(governance=False, active_budget=1)
    for i, way in enumerate(WAYS):
        bank.admit(Lesson("procedural_hint", way), verdicts["success"], task=f"task {i}", trusted=True)
    clock.pass_days(30)
    assert bank.govern().changes == 0
    assert len(bank.records(["active"])) == 3


def test_the_same_history_gives_the_same_bank(
    open_bank: Open, verdicts: Any, many_lessons: Any, clock: Any
) -> None:
    rng = random.Random(3)
    lessons = many_lessons(40) + [(Lesson("procedural_hint", way), f"task {i}") for i, way in enumerate(WAYS)]
    lessons += [(Lesson("procedural_hint", f"Lift the cup {n} cm."), "cup") for n in (5, 15, 30)]
    rng.shuffle(lessons)
    seen = []
    start = clock.now
    for name in ("one", "other"):
        clock.now = start
        bank = open_bank(name, active_budget=30)
        for lesson, task in lessons:
            clock.now += 60
            bank.admit(lesson, verdicts["success"], task=task, source=task, trusted=True)
        bank.govern()
        rows = [(r.content, r.state, r.count, r.confidence, r.note.partition(" ")[0]) for r in bank.records()]
        seen.append(sorted(rows))
    assert seen[0] == seen[1]


def test_lessons_too_long_for_one_summary_stay_apart(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank()
    rest = "and then look at the gauge again before going on with the next of the bolts " * 21
    for i, start in enumerate(("Tighten it slowly", "Slowly tighten it", "Tighten it, slowly")):
        lesson = Lesson("procedural_hint", f"{start} {rest}{i}")
        bank.admit(lesson, verdicts["success"], task=f"task {i}", source=f"run/{i}", trusted=True)
    bank.govern()
    assert not bank.records(["summary"])
    assert bank.records(["active"])


# Programs -----------------------------------------------------------------------------------------------------------


def program(*steps: str, theme: str = "cup cylinder") -> Lesson:
    roles = {"theme": theme, "goal": "box"}
    effect = {"kind": "program", "skill": "place", "language": "calls", "roles": roles, "steps": list(steps)}
    return Lesson("procedural_hint", f"{len(steps)} steps put the {theme} into the box.", effect)


def test_of_programs_the_few_that_differ_in_kind_stay_the_best_borne_out_first(
    open_bank: Open, episode: Open, verdicts: Any
) -> None:
    bank = open_bank()
    acts = ("pick", "push", "tilt", "slide")
    often = program("pick({theme})", "place({theme}, {goal}, in)")
    for _ in range(3):
        bank.learn(episode("put the cup into the box", often, skill="place"), verdicts["success"])
    same_kind = program("pick({theme})", "place({theme}, {goal}, on)")
    bank.learn(episode("put the cup into the box", same_kind, skill="place"), verdicts["success"])
    for act in acts:
        bank.learn(
            episode("put the cup into the box", program(f"{act}({{theme}})"), skill="place"),
            verdicts["success"],
        )
    elsewhere = program("pick({theme})", theme="book cuboid")
    bank.learn(episode("put the book into the box", elsewhere, skill="place"), verdicts["success"])
    kept = [r for r in bank.records(["active"]) if "cup" in r.content]
    assert len(kept) == 3
    best = max(kept, key=lambda r: r.count)
    assert (best.count, best.effect_json()) == (3, often.effect)  # it comes back as it was
    assert len({str(r.effect_json()["steps"]) for r in kept}) == 3
    assert [r.effect_json() for r in bank.records(["active"]) if "book" in r.content] == [elsewhere.effect]
    assert not [
        link for link in look(bank.store, bank.bank).links() if link.kind in ("conflict", "suspicion")
    ]
    assert bank.govern().changes == 0
    assert bank.verify() == []
