"""What contradicts: typed effects exactly, texts by a judge."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gvla2.memory.admission import effects_conflict
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Judgement, Lesson, LessonPair
from gvla2.memory.records import Record
from gvla2.memory.review import PAIRS
from gvla2.memory.review import judge as judge_lessons
from tests.memory.looking import look

Open = Callable[..., Any]


def record(id: str, **more: Any) -> Record:
    made = Record(
        id=id, bank="b", query=f"task of {id}", content=f"Lift the cup in the way of {id}.", type="procedural_hint",
        state="active", outcome="verified_success", confidence=0.9, quality=0.9, dedup_key=id, created=0.0, updated=0.0,
    )  # fmt: skip
    return replace(made, **more)


def bound(op: str, value: float, **more: Any) -> dict[str, Any]:
    return {"kind": "bound", "parameter": "lift", "op": op, "value": value, **more}


def prior(value: float, count: int = 1, sd: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"kind": "prior", "parameter": "lift", "value": value, "count": count, "sd": sd, **more}


PROGRAM = {"kind": "program", "skill": "pick", "language": "calls", "steps": ["lift 5 cm"]}


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (bound(">=", 0.3), bound("<=", 0.2)),
        (prior(0.3, 5, 0.01), prior(0.1, 5, 0.01)),
        (prior(0.3), prior(0.1)),
        ({"kind": "forbid", "parameter": "lift"}, prior(0.1)),
    ],
)
def test_effects_that_leave_nothing_between_them(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert "lift" in effects_conflict(first, second)
    assert effects_conflict(second, first)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (bound(">=", 0.1), bound("<=", 0.2)),
        (bound(">=", 0.3), bound(">=", 0.1)),
        (bound(">=", 0.3, scale="height"), bound("<=", 0.2)),
        (bound(">=", 0.3, object="cup"), bound("<=", 0.2, object="jar")),
        (bound(">=", 0.3, skill="pick"), bound("<=", 0.2, skill="push")),
        (prior(0.3, 2, 0.1), prior(0.2, 2, 0.1)),
        (bound(">=", 0.3), {**bound("<=", 0.2), "parameter": "depth"}),
        (bound(">=", float("nan")), bound("<=", 0.2)),
        (bound(">=", 0.3), {"kind": "bound", "parameter": "lift", "op": "<=", "value": "much"}),
        (PROGRAM, {**PROGRAM, "steps": ["lift 50 cm"]}),
        (PROGRAM, prior(0.3)),
        ({"kind": "forbid", "parameter": "lift"}, {"kind": "forbid", "parameter": "lift"}),
    ],
)
def test_effects_that_fit_or_cannot_be_compared(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert effects_conflict(first, second) == ""
    assert effects_conflict(second, first) == ""


def test_the_bank_keeps_links_to_both_and_archives_the_loser(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(governance=True)
    at_least = Lesson("procedural_hint", "Lift it at least 15 cm.", bound(">=", 0.15))
    at_most = Lesson("procedural_hint", "Lift it at most 5 cm.", bound("<=", 0.05))
    (old,) = bank.admit(at_least, verdicts["success"], task="cup", trusted=True).added
    learned = bank.admit(at_most, verdicts["success"], task="cup", trusted=True)
    (new,) = learned.added
    assert {r.id: r.state for r in bank.records()} == {old: "archive", new: "active"}
    links = {(k.source, k.kind, k.target) for k in look(bank.store, bank.bank).links()}
    assert links == {(new, "conflict", old)}
    assert any(old in note for note in learned.notes)
    # The loser is found again when it is said again, and comes back once it has more behind it.
    assert bank.admit(at_least, verdicts["success"], task="cup", trusted=True).merged == (old,)
    assert {r.id: r.state for r in bank.records()} == {old: "active", new: "archive"}
    assert bank.admit(at_most, verdicts["unavailable"], task="cup").discarded
    assert {r.id: r.state for r in bank.records()} == {old: "active", new: "archive"}
    assert bank.verify() == []


# By a judge


class Fixed:
    """A judge that always answers the same, and keeps what it was asked."""

    def __init__(self, contradicts: bool | None) -> None:
        self.contradicts, self.batches = contradicts, list[Sequence[LessonPair]]()

    def judge(self, pairs: Sequence[LessonPair]) -> Sequence[Judgement]:
        self.batches.append(pairs)
        return [Judgement(self.contradicts, 0.9, "because", "fixed") for _ in pairs]


def judged(path: Path, judge: Fixed, *records: Record) -> KnowledgeBank:
    bank = KnowledgeBank(path / "m.db", bank="b", clock=lambda: 1.8e9)
    with bank.store.writing("b", actor="test", now=1.8e9) as t:
        for one in records:
            t.put(one, "ADD")
    judge_lessons(bank, judge, [one.id for one in records])
    assert bank.verify() == []
    return bank


def test_similar_texts_are_asked_about_and_only_once(tmp_path: Path) -> None:
    bound = '{"kind":"bound","parameter":"lift","op":">=","value":0.1}'
    records = [record(f"r{i:02}") for i in range(20)]
    records += [record("typed", effect=bound), record("far", content="Salt the soup.", query="cook")]
    asked = Fixed(False)
    with judged(tmp_path, asked, *records) as bank:
        assert len(asked.batches[0]) == PAIRS
        for _ in range(9):
            judge_lessons(bank, asked, [one.id for one in records])
        pairs = [frozenset((pair.first, pair.second)) for batch in asked.batches for pair in batch]
        assert len({*pairs}) == len(pairs) > PAIRS
        shown = {text for pair in pairs for text in pair}
        assert not {"Salt the soup.", "Lift the cup in the way of typed."} & shown
        assert len(look(bank.store, "b").links()) == len(pairs)


@pytest.mark.parametrize("contradicts", [None, False, True])
def test_what_an_answer_does(tmp_path: Path, contradicts: bool | None) -> None:
    with judged(tmp_path, Fixed(contradicts), record("a"), record("b", count=9)) as bank:
        states = {one.id: one.state for one in bank.records()}
        links = [link.kind for link in look(bank.store, "b").links()]
        assert links == ([] if contradicts is None else ["conflict" if contradicts else "dismissed"])
        events = [e for id in "ab" for e in look(bank.store, "b").history(id) if e.action.startswith("link")]
        assert [e.why for e in events] == ["fixed: because (p = 0.90)"] * len(links)
        assert states == {"a": "archive" if contradicts else "active", "b": "active"}
        assert bank.index.get("b").conflicts == 0, "what is settled counts against nobody"


@pytest.mark.parametrize("trusted", ["a", "b"])
def test_the_less_trusted_one_loses(tmp_path: Path, trusted: str) -> None:
    made = [record(id, **({} if id == trusted else {"trust": "foreign", "count": 50})) for id in "ab"]
    with judged(tmp_path, Fixed(True), *made) as bank:
        assert [one.id for one in bank.records(["active"])] == [trusted]


def test_a_hint_and_a_constraint_both_stay(tmp_path: Path) -> None:
    with judged(tmp_path, Fixed(True), record("a"), record("b", type="failure_avoidance")) as bank:
        assert len(bank.records(["active"])) == 2


def test_a_bank_asks_its_judge_about_what_it_learns(tmp_path: Path, verdicts: Any) -> None:
    judge = Fixed(True)
    with KnowledgeBank(tmp_path / "m.db", judge=judge) as bank:
        for side in ("left", "right"):
            bank.learn("open the jar", "", success=True, lessons=[f"Turn the lid of the jar to the {side}."])
        assert len(bank.records(["active"])) == 1
    assert [len(batch) for batch in judge.batches] == [1]
