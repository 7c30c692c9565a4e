"""Who plans: second tries with the rejected plan, and a fallback planner that is never silent."""

from contextlib import closing
from dataclasses import replace

import pytest

from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.episode.planning import NamedPlanner, PlannerWithFallback
from gvla2.language import MalformedAnswerError, ModelUnavailableError
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.trajectory import Trajectory
from tests.composing import composed, offer
from tests.quick import QUICK

SMALL = (*QUICK, "memory=none")
TALK = ({"role": "assistant", "content": "I cannot"},)


class Answering:
    """A planner of given answers, one after the other; an error is raised, a function asked."""

    def __init__(self, *answers):
        self.answers, self.requests = list(answers), []

    def plan(self, request):
        self.requests.append(request)
        answer = self.answers.pop(0)
        if isinstance(answer, BaseException):
            raise answer
        return answer(request) if callable(answer) else answer


@pytest.fixture(scope="module")
def parts(registry):
    offer(registry)
    made = build_components(composed("run", *SMALL, "fallback=skill"), registry)
    with closing(made.robot), closing(made.memory):
        yield made


@pytest.fixture(scope="module")
def seen(parts):
    """An episode up to its planning."""
    record = run(parts, Answering(declined("no_goal")))
    return replace(record, plan=None, failure=None)


def planning(parts, planner):
    return PlannerWithFallback(
        NamedPlanner("mine", planner),
        NamedPlanner("skill", parts.fallback),
        60.0,
        parts.robot.arm,
        parts.skills,
    )


def sunk(planner, by=0.3):
    """Its plan, ``by`` metres under the table: no check passes that."""

    def plan(request):
        made = planner.plan(request)
        low = [replace(w, xyz=(w.xyz[0], w.xyz[1], w.xyz[2] - by)) for w in made.trajectory]
        return replace(made, trajectory=Trajectory(tuple(low)))

    return plan


def run(parts, planner, **more):
    return run_episode(replace(parts, planner=planner), EpisodeRequest(seed=1, **more))


def declined(kind):
    return Plan(None, abstention=Abstention(kind, "I would rather not."), transcript=TALK)


FAILING = {
    "no model": (ModelUnavailableError("nobody there"),),
    "a cut answer": (MalformedAnswerError("cut off"),),
    "no plan": ("rubbish",),
    "no means": (declined("other"),),
    "no skill": (declined("unknown_skill"),),
    "no reach": (declined("unreachable"),),
}


@pytest.mark.parametrize("answers", FAILING.values(), ids=FAILING)
def test_the_fallback_steps_in_and_says_so(parts, seen, answers):
    planner = Answering(*answers)
    stages = planning(parts, planner)
    record = stages.check(stages.plan(seen))
    assert record.failure is None, record.failure
    assert record.checks.passed
    assert record.plan.fallback == "skill"
    (note,) = [n for n in record.notes if "fallback planner 'skill' stepped in" in n]
    assert not planner.answers
    if isinstance(answers[0], Plan):
        assert record.plan.transcript[:1] == TALK, "the first planner's conversation is kept"
        assert answers[0].abstention.kind in note


@pytest.mark.parametrize("kind", ["nothing_matches", "ambiguous", "no_goal", "too_wide"])
def test_a_real_refusal_stands(parts, kind):
    record = run(parts, Answering(declined(kind)))
    assert (record.failure.stage, record.failure.kind) == ("plan", kind)
    assert record.plan.fallback == ""
    assert record.report is None


def test_a_rejected_planner_gets_the_reasons_and_then_the_fallback_plans(parts):
    inner = parts.fallback
    planner = Answering(sunk(inner), sunk(inner))
    record = run(parts, planner)
    first, second = planner.requests
    assert not first.rejections
    assert any("above the table" in reason for reason in second.rejections)
    assert record.plan.fallback == "skill"
    assert any("was rejected twice" in note for note in record.notes)
    assert record.success_check.relaxed


def test_where_both_fail_both_are_named(parts):
    broken = replace(parts, fallback=Answering(MalformedAnswerError("prose")))
    record = run(broken, Answering(ModelUnavailableError("nobody there")))
    assert record.failure.stage == "plan"
    assert "nobody there" in record.failure.message
    assert "prose" in record.failure.message
    assert record.report is None
