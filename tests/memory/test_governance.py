"""What a bank keeps: retirement, contradictions, programs, budgets; after each episode and as a whole."""

import random
from collections.abc import Callable
from typing import Any

from gvla2.memory.contracts import Lesson, MemoryTask
from gvla2.memory.learning import PROGRAMS, JudgedEpisode, admit
from tests.memory.corpus import lessons as records
from tests.memory.looking import look

Open = Callable[..., Any]


def many_lessons(count: int, seed: int = 0) -> list[tuple[Lesson, str]]:
    """Random lessons about many tasks, each with its task."""
    return [(Lesson("procedural_hint", one.content), one.query) for one in records(count, seed)]


def test_beyond_the_budget_what_was_neither_helpful_nor_confirmed_goes_first_and_the_oldest_of_it(
    open_bank: Open, episode: Open, verdicts: Any, clock: Any
) -> None:
    bank = open_bank(active_budget=5)
    recalled = None
    for part in ("lid", "knob", "knob", "hinge", "button", "handle", "drawer", "cap"):
        clock.now += 60
        avoid = Lesson("failure_avoidance", f"Moving the {part}: failed because it was loose.")
        bank.learn(episode(f"Move the {part}", avoid, skill="", recalled=recalled), verdicts["success"])
        recalled = bank.recall(MemoryTask("Move the lid")) if part == "lid" else None
    kept = [record.content.split()[2].rstrip(":") for record in bank.records(["active"])]
    assert sorted(kept) == ["cap", "drawer", "handle", "knob", "lid"]


def test_stale_failures_that_nobody_used_retire(
    open_bank: Open, episode: Open, verdicts: Any, clock: Any
) -> None:
    bank = open_bank(governance=True)
    avoid = Lesson("failure_avoidance", "Moving the jar: failed because the lid was loose.")
    used = Lesson("failure_avoidance", "Moving the lamp: failed because the cable was short.")
    tool = Lesson("tool_usage", "The crane needs air.")
    bank.learn(episode("Move the jar", avoid, skill=""), verdicts["fail"])
    bank.learn(episode("Move the lamp", used, skill=""), verdicts["fail"])
    recalled = bank.recall(MemoryTask("Move the lamp with the short cable"))
    bank.learn(episode("Run the crane", tool, skill="", recalled=recalled), verdicts["success"])
    for days, retired in ((13, 0), (2, 1)):
        clock.pass_days(days)
        bank.learn(episode("Run the crane", tool, skill=""), verdicts["success"])
        assert len(bank.records(["archive"])) == retired
    (gone,) = bank.records(["archive"])
    assert "jar" in gone.content
    assert "14 days" in gone.note
    assert [e.action for e in look(bank.store, bank.bank).history(gone.id)][-1] == "RETIRE"


def test_without_governance_nothing_retires_and_contradicting_lessons_both_stay(
    open_bank: Open, episode: Open, verdicts: Any, clock: Any
) -> None:
    bank = open_bank()
    effect = {"kind": "bound", "parameter": "lift", "op": ">=", "value": 0.15}
    high = Lesson("procedural_hint", "Lift it at least 15 cm.", effect)
    low = Lesson("procedural_hint", "Lift it at most 5 cm.", {**effect, "op": "<=", "value": 0.05})
    avoid = Lesson("failure_avoidance", "Moving the jar: failed because the lid was loose.")
    for lesson, verdict in ((high, "success"), (low, "success"), (avoid, "fail")):
        bank.learn(episode("Lift the cup", lesson, skill=""), verdicts[verdict])
        clock.pass_days(30)
    assert [record.state for record in bank.records()] == ["active"] * 3
    assert look(bank.store, bank.bank).links() == []


def test_the_budget_holds_however_much_comes_in(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(active_budget=40, provisional_budget=15)
    items = [(lesson, verdicts["success"], task) for lesson, task in many_lessons(150)]
    items += [(lesson, verdicts["uncertain"], task) for lesson, task in many_lessons(60, seed=1)]
    judged = [
        JudgedEpisode.lesson(lesson, verdict, MemoryTask(task), "", own=True)
        for lesson, verdict, task in items
    ]
    for start in range(0, len(items), 30):
        admit(bank, judged[start : start + 30])
        assert len(bank.records(["active"])) <= 40
        assert len(bank.records(["provisional"])) <= 15
        assert not bank.index.records("archive")  # it takes no room in memory
    assert len(bank.records()) == 210  # nothing was deleted
    assert bank.verify() == []


def test_the_same_history_gives_the_same_bank(open_bank: Open, verdicts: Any, clock: Any) -> None:
    rng = random.Random(3)
    lessons = many_lessons(40) + [
        (Lesson("procedural_hint", f"Lift the cup {n} cm."), "cup") for n in (5, 15, 30)
    ]
    rng.shuffle(lessons)
    seen = []
    start = clock.now
    for name in ("one", "other"):
        clock.now = start
        bank = open_bank(name, active_budget=30)
        for lesson, task in lessons:
            clock.now += 60
            bank.admit(lesson, verdicts["success"], task=task, source=task, trusted=True)
        rows = [(r.content, r.state, r.count, r.confidence, r.note.partition(" ")[0]) for r in bank.records()]
        seen.append(sorted(rows))
    assert seen[0] == seen[1]


# Programs -----------------------------------------------------------------------------------------------------------


def program(*steps: str, theme: str = "cup cylinder") -> Lesson:
    roles = {"theme": theme, "goal": "box"}
    effect = {"kind": "program", "skill": "place", "language": "calls", "roles": roles, "steps": list(steps)}
    return Lesson("procedural_hint", f"{len(steps)} steps put the {theme} into the box.", effect)


def test_of_programs_the_few_with_most_evidence_stay(open_bank: Open, episode: Open, verdicts: Any) -> None:
    bank = open_bank()
    often = program("pick({theme})", "place({theme}, {goal}, in)")
    for lesson in (
        often,
        often,
        *(program(f"{act}({{theme}})") for act in ("push", "tilt", "slide", "turn")),
    ):
        bank.learn(episode("put the cup into the box", lesson, skill="place"), verdicts["success"])
    elsewhere = program("pick({theme})", theme="book cuboid")
    bank.learn(episode("put the book into the box", elsewhere, skill="place"), verdicts["success"])
    kept = [r for r in bank.records(["active"]) if "cup" in r.content]
    assert len(kept) == PROGRAMS
    best = max(kept, key=lambda r: r.count)
    assert (best.count, best.effect_json()) == (2, often.effect)  # it comes back as it was
    assert [r.effect_json() for r in bank.records(["active"]) if "book" in r.content] == [elsewhere.effect]
    assert not look(bank.store, bank.bank).links()
    assert bank.verify() == []
