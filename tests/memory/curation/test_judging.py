"""Suspicions decided in the background: what is asked, what an answer means, and what it cost."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Judgement, Suspects
from gvla2.memory.curation.contesting import SUSPECT
from gvla2.memory.curation.judging import BATCH, Judged, decide, judge
from gvla2.memory.records import Record
from gvla2.memory.storage.writing import Put
from tests.memory.looking import look


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


@pytest.mark.parametrize("decided", ["dismissed", "conflict"])
def test_open_are_the_suspicions_that_nobody_decided(tmp_path: Path, decided: str) -> None:
    asked = Fixed(None)
    with KnowledgeBank(tmp_path / "m.db", bank="b", clock=lambda: 1.8e9) as bank:
        with bank.store.writing("b", actor="test", now=1.8e9) as t:
            t.put_many([Put(record(id), "ADD") for id in "abcdyz"])
            for first, kind, second in (
                ("a", "suspicion", "b"), ("b", "suspicion", "a"), ("c", "suspicion", "d"), ("d", decided, "c"),
                ("a", "merged", "c"), ("z", "suspicion", "y"),
            ):  # fmt: skip
                t.link_many({(first, kind, second): ""})
        judge(bank, asked)
    assert [(pair.first, pair.second) for (batch,) in [asked.batches] for pair in batch] == [
        ("text of a", "text of b"), ("text of y", "text of z")
    ]  # fmt: skip


def test_pairs_are_asked_in_batches_and_their_cost_is_counted() -> None:
    records = {f"r{i:02}": record(f"r{i:02}") for i in range(BATCH + 5)}
    pairs = [("r00", id) for id in list(records)[1:]]
    asked, done = Fixed(False), Judged()
    rulings = decide(asked, pairs, records, done)
    assert [len(batch) for batch in asked.batches] == [BATCH, 4]
    assert asked.batches[0][0] == Suspects("text of r00", "text of r01", "task of r00", "task of r01", 0.0)
    assert {answer.contradicts for _, answer in rulings} == {False}
    assert (len(done.dismissed), done.usage["calls"]) == (BATCH + 4, 2 * (BATCH + 4))


def test_a_judge_hears_how_likely_the_suspicion_is() -> None:
    english, german = (
        ("Lift the cup slowly.", "Lift the cup quickly."),
        ("Hebe sie nicht an.", "Hebe sie an."),
    )
    for texts, low, high in ((english, SUSPECT, 1.0), (german, 0.5, 0.5)):
        records = {id: record(id, query="lift", content=text) for id, text in zip("ab", texts, strict=True)}
        asked = Fixed(None)
        decide(asked, [("a", "b")], records, Judged())
        assert low <= asked.batches[0][0].suspicion <= high


def test_what_is_gone_or_beyond_the_limit_is_not_asked() -> None:
    records = {id: record(id) for id in "acd"}
    asked, done = Fixed(None), Judged()
    assert decide(asked, [("a", "x"), ("a", "c"), ("c", "d")], records, done, limit=1) == []
    assert [len(batch) for batch in asked.batches] == [1]
    assert (done.open, done.notes) == (1, ["because"])


@pytest.fixture
def two(tmp_path: Path):
    """Judges two suspected records; gives what was done, their states, and the links, by kind with the reason."""

    def judged(contradicts: bool | None, first: Record, second: Record):
        with KnowledgeBank(tmp_path / "m.db", bank="b", clock=lambda: 1.8e9) as bank:
            with bank.store.writing("b", actor="test", now=1.8e9) as t:
                t.put_many([Put(first, "ADD"), Put(second, "ADD")])
                t.link_many({(first.id, "suspicion", second.id): ""})
            done = judge(bank, Fixed(contradicts))
            assert bank.verify() == []
            why = {event.action: event.why for event in look(bank.store, bank.bank).history(first.id)}
            links = {
                x.kind: why.get(f"link:{x.kind}")
                for x in look(bank.store, bank.bank).links()
                if x.kind != "suspicion"
            }
            return done, {one.id: one.state for one in bank.records()}, links

    return judged


def test_what_is_left_open_changes_nothing(two: Any) -> None:
    done, states, links = two(None, record("a"), record("b"))
    assert (done.open, states, links) == (1, {"a": "active", "b": "active"}, {})


@pytest.mark.parametrize("trusted", ["a", "b"])
def test_the_less_trusted_one_loses(two: Any, trusted: str) -> None:
    made = (record(id, **({} if id == trusted else {"trust": "confirmed", "count": 50})) for id in "ab")
    done, states, links = two(True, *made)
    assert done.conflicts == [("a", "b")]
    assert [id for id, state in states.items() if state == "active"] == [trusted]
    assert set(links) == {"conflict", "replaces"}


def test_of_two_equally_trusted_the_one_with_less_evidence_loses(two: Any) -> None:
    done, states, _ = two(True, record("a"), record("b", count=9))
    assert (done.archived, states["b"]) == (["a"], "active")


def test_a_hint_and_a_constraint_both_stay(two: Any) -> None:
    done, states, links = two(True, record("a"), record("b", type="failure_avoidance"))
    assert (done.archived, set(states.values()), set(links)) == ([], {"active"}, {"conflict"})


@pytest.mark.parametrize(("contradicts", "kind"), [(True, "conflict"), (False, "dismissed")])
def test_a_ruling_says_who_and_why(two: Any, contradicts: bool, kind: str) -> None:
    _, _, links = two(contradicts, record("a"), record("b"))
    assert links[kind] == "fixed: because (p = 0.90)"
