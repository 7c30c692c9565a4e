"""Verifying again: promotion, demotion, and verifiers that cannot judge."""

from collections.abc import Callable
from typing import Any

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import Evidence, Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.review import replay
from tests.memory.looking import look

Open = Callable[..., Any]
AVOID = Lesson("failure_avoidance", "Never pull the drawer by its label.")
HINT = Lesson("procedural_hint", "Pull the drawer by its handle.")
PULLED = Lesson(HINT.type, HINT.content, {"kind": "prior", "parameter": "pull", "value": 0.3})
NEVER = Lesson("failure_avoidance", "Never pull the drawer.", {"kind": "forbid", "parameter": "pull"})


class Judge:
    """Gives the verdicts of a script, and remembers what it was shown."""

    def __init__(self, *verdicts: Verdict) -> None:
        self.verdicts, self.seen = list(verdicts), []  # type: ignore[var-annotated]

    def verify(self, evidence: Evidence) -> Verdict:
        self.seen.append(evidence)
        return self.verdicts[min(len(self.seen), len(self.verdicts)) - 1]


def learned(source: str = "run/1", *lessons: Lesson) -> MemoryEpisode:
    return MemoryEpisode(
        MemoryTask("Open the drawer"),
        lessons or (HINT,),
        transcript="- pulled the handle\n- the drawer opened",
        source=source,
        facts={"exit_status": 0},
    )


def test_a_provisional_record_is_promoted_by_a_second_verdict(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(admission=True, replay=True)
    (id,) = bank.learn(learned(), verdicts["uncertain"]).provisional
    judge = Judge(verdicts["success"])
    replay(bank, judge)
    assert judge.seen[0].facts == {"exit_status": 0}
    assert "handle" in judge.seen[0].transcript
    (record,) = bank.records(["active"])
    assert (record.outcome, record.confidence) == ("verified_success", verdicts["success"].confidence)
    assert [e.action for e in look(bank.store, bank.bank).history(id)] == ["PROVISIONAL", "PROMOTE"]
    assert bank.recall("open the drawer by its handle").items
    assert bank.verify() == []


def test_a_recipe_of_an_episode_that_failed_after_all_is_archived(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(admission=True, replay=True)
    bank.learn(learned(), verdicts["uncertain"])
    replay(bank, Judge(verdicts["fail"]))
    assert [r.state for r in bank.records()] == ["archive"]


@pytest.mark.parametrize("raises", [False, True])
def test_an_unavailable_verifier_changes_nothing(open_bank: Open, verdicts: Any, raises: bool) -> None:
    class Broken:
        def verify(self, evidence: Evidence) -> Verdict:
            if raises:
                raise MemoryStoreError("no network")
            return verdicts["unavailable"]

    bank = open_bank(admission=True, replay=True)
    bank.learn(learned(), verdicts["uncertain"])
    before, events = bank.records(), bank.stats()["events"]
    replay(bank, Broken())
    assert bank.records() == before
    assert bank.stats()["events"] == events


def test_contested_records_are_looked_at_again_and_demoted(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(admission=True, replay=True, governance=True)
    bank.learn(learned("run/1", PULLED), verdicts["success"])
    bank.learn(learned("run/2", NEVER), verdicts["fail"])
    assert [link.kind for link in look(bank.store, bank.bank).links()] == ["conflict"]
    judge = Judge(verdicts["fail"])
    replay(bank, judge, limit=9)
    assert len(judge.seen) == 2
    states = {r.type: r.state for r in bank.records()}
    assert states == {"procedural_hint": "archive", "failure_avoidance": "active"}


def test_one_doubtful_verdict_does_not_overthrow_many_episodes(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(admission=True, replay=True, governance=True)
    for i in range(9):
        bank.learn(learned(f"run/{i}", PULLED), verdicts["success"])
    bank.learn(learned("other", NEVER), verdicts["fail"])
    judge = Judge(verdicts["fail"])
    replay(bank, judge, limit=2)
    assert len(judge.seen) == 2
    (hint,) = [r for r in bank.records(["active"]) if r.type == "procedural_hint"]
    assert 0.4 <= hint.confidence < 0.85


def test_learning_verifies_one_earlier_episode_again(open_bank: Open, verdicts: Any) -> None:
    judge = Judge(verdicts["success"])
    bank = open_bank(admission=True, replay=True, verifier=judge)
    bank.learn(learned("run/1"), verdicts["uncertain"])
    assert judge.seen == []  # its own episode has just been judged
    bank.learn(MemoryEpisode(MemoryTask("Water the fern"), (AVOID,), source="run/2"), verdicts["fail"])
    assert len(judge.seen) == 1
    assert {r.state for r in bank.records()} == {"active"}


def test_replay_has_to_be_switched_on(open_bank: Open, verdicts: Any) -> None:
    judge = Judge(verdicts["success"])
    bank = open_bank(admission=True, verifier=judge)
    bank.learn(learned("run/1"), verdicts["uncertain"])
    bank.learn(learned("run/2", AVOID), verdicts["fail"])
    assert judge.seen == []


def test_of_a_promoted_record_and_one_that_contradicts_it_one_stays(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(admission=True, replay=True, governance=True)
    other = Lesson(HINT.type, "Pull the drawer far.", {**PULLED.effect, "value": 0.9})
    (first,) = bank.learn(learned("run/1", PULLED), verdicts["success"]).added
    (second,) = bank.learn(learned("run/2", other), verdicts["uncertain"]).provisional
    replay(bank, Judge(verdicts["success"]))
    assert sorted((r.id in (first, second), r.state) for r in bank.records()) == [
        (True, "active"),
        (True, "archive"),
    ]
    assert bank.verify() == []


def test_a_forgotten_episode_cannot_be_replayed(open_bank: Open, verdicts: Any) -> None:
    bank = open_bank(admission=True, replay=True)
    (id,) = bank.learn(learned(), verdicts["uncertain"]).provisional
    assert bank.forget(id)
    assert not bank.forget(id)
    judge = Judge(verdicts["success"])
    replay(bank, judge)
    assert judge.seen == []
    assert bank.records() == []
