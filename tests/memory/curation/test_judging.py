"""Suspicions decided in the background: what is asked, what an answer means, and what it cost."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from gvla2.memory.contracts import Judgement, Suspects
from gvla2.memory.curation.evidence import standing
from gvla2.memory.curation.judging import BATCH, Judged, decide, open_suspicions, ruled
from gvla2.memory.records import Record


def record(id: str, **more: object) -> Record:
    made = Record(
        id=id, bank="b", query=f"task of {id}", content=f"text of {id}", type="procedural_hint", state="active",
        outcome="verified_success", confidence=0.9, quality=0.9, dedup_key=id, created=0.0, updated=0.0,
    )  # fmt: skip
    return replace(made, **more)  # type: ignore[arg-type]


class Fixed:
    """A judge that always answers the same, and keeps what it was asked."""

    def __init__(self, contradicts: bool | None) -> None:
        self.contradicts, self.batches = contradicts, list[Sequence[Suspects]]()

    def judge(self, suspects: Sequence[Suspects]) -> Sequence[Judgement]:
        self.batches.append(suspects)
        return [Judgement(self.contradicts, 0.9, "because", "fixed", {"calls": 2}) for _ in suspects]


def test_open_are_the_suspicions_that_nobody_decided() -> None:
    links = [
        ("a", "suspicion", "b"), ("b", "suspicion", "a"), ("c", "suspicion", "d"), ("d", "dismissed", "c"),
        ("e", "suspicion", "f"), ("f", "conflict", "e"), ("g", "merged", "h"), ("z", "suspicion", "y"),
    ]  # fmt: skip
    assert open_suspicions(links) == [("a", "b"), ("y", "z")]


def test_pairs_are_asked_in_batches_and_their_cost_is_counted() -> None:
    records = {f"r{i:02}": record(f"r{i:02}") for i in range(BATCH + 5)}
    pairs = [("r00", id) for id in list(records)[1:]]
    judge, done = Fixed(False), Judged()
    rulings = decide(judge, pairs, records, done)
    assert [len(batch) for batch in judge.batches] == [BATCH, 4]
    assert judge.batches[0][0] == Suspects("text of r00", "text of r01", "task of r00", "task of r01")
    assert {ruling.kind for ruling in rulings} == {"dismissed"}
    assert (len(done.dismissed), done.usage["calls"]) == (BATCH + 4, 2 * (BATCH + 4))


def test_what_is_gone_or_beyond_the_limit_is_not_asked() -> None:
    records = {"a": record("a"), "b": record("b", state="archive"), "c": record("c"), "d": record("d")}
    judge = Fixed(None)
    done = Judged()
    assert decide(judge, [("a", "b"), ("a", "x"), ("a", "c"), ("c", "d")], records, done, limit=1) == []
    assert [len(batch) for batch in judge.batches] == [1]
    assert (done.open, done.notes) == (1, ["because"])


def answer(contradicts: bool | None) -> Judgement:
    return Judgement(contradicts, 0.9, "because", "fixed")


def test_what_is_left_open_changes_nothing() -> None:
    assert ruled(record("a"), record("b"), answer(None)) is None


def test_the_less_trusted_one_loses_then_the_one_with_less_evidence() -> None:
    ours, theirs = record("a"), record("b", trust="confirmed", count=50)
    for first, second in ((ours, theirs), (theirs, ours)):
        ruling = ruled(first, second, answer(True))
        assert ruling is not None
        assert (ruling.kind, ruling.loser) == ("conflict", "b")
    many = record("c", count=9)
    assert standing(many) < standing(ours)


def test_a_hint_and_a_constraint_both_stay() -> None:
    ruling = ruled(record("a"), record("b", type="failure_avoidance"), answer(True))
    assert ruling is not None
    assert ruling.loser == ""


@pytest.mark.parametrize(("contradicts", "kind"), [(True, "conflict"), (False, "dismissed")])
def test_a_ruling_says_who_and_why(contradicts: bool, kind: str) -> None:
    ruling = ruled(record("a"), record("b"), answer(contradicts))
    assert ruling is not None
    assert (ruling.kind, ruling.why) == (kind, "fixed: because (p = 0.90)")
