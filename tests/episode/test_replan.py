"""Planning anew after a failed attempt, with the real simulator, perceiver, planner, memory and verifier."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.episode.attempts import cameras_moved, hand_is_free
from gvla2.episode.loop import EpisodeRequest, SilentListener, run_episode
from gvla2.episode.planning import advice_for
from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Views
from gvla2.memory.contracts import MemoryContext, MemoryItem
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.effects import Prior
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.testing import inputs
from tests.quick import QUICK


class Listener(SilentListener):
    def __init__(self):
        self.stages, self.records = [], []

    def stage(self, record, stage):
        self.stages.append(stage)
        self.records.append(record)


class Clumsy:
    """A planner whose first ``times`` answers never close the hand and are ``off`` metres beside."""

    def __init__(self, planner, times=1, off=(0.0, 0.0, 0.0), then=None):
        self._planner, self._times, self._off, self._then = planner, times, np.array(off), then
        self.requests = []

    def plan(self, request):
        self.requests.append(request)
        if len(self.requests) > self._times:
            return self._then or self._planner.plan(request)
        plan = self._planner.plan(request)
        beside = tuple(
            replace(w, xyz=tuple((np.array(w.xyz) + self._off).tolist()), carries="", gripper=1.0)
            for w in plan.trajectory
        )
        return replace(plan, trajectory=Trajectory(beside))


def test_a_failed_attempt_is_seen_and_another_one_succeeds(parts_of):
    parts, listener = parts_of(*QUICK), Listener()
    clumsy = Clumsy(parts.planner)
    record = run_episode(replace(parts, planner=clumsy), EpisodeRequest(seed=1, replan=1), listener)
    assert record.failure is None, record.failure
    assert record.success_check.relaxed
    assert record.verdict.outcome == "verified_success"
    (first,) = record.attempts
    assert (first.failure.kind, first.verdict.outcome) == ("not_achieved", "verified_fail")
    assert first.report.completed
    assert set(first.timings) >= {"setup", "observe", "plan", "execute", "verify"}
    assert listener.stages == [
        "setup", "observe", "perceive", "reconstruct", "recall", "plan", "check", "execute", "verify",
        "observe", "perceive", "reconstruct", "plan", "check", "execute", "verify", "learn", "success_check",
    ]  # fmt: skip
    assert all(r.success_check is None for r in listener.records[:-1])
    # The arm went home in between, its hand open, and looked anew.
    home = parts.robot.arm.forward(parts.robot.arm.home)
    np.testing.assert_allclose(record.observation.world_from_tcp, home, atol=0.02)
    assert record.observation.gripper > 0.95
    assert "Earlier in this episode, attempt 1 (pick) failed" in clumsy.requests[1].advice.text
    # Both were learned: the failure's lesson beside those of the success.
    types = {item.type for item in parts.memory.recall(_task_of(record)).items}
    assert "procedural_hint" in types
    assert len(record.learned.added) > len(run_episode(parts, EpisodeRequest(seed=4)).learned.added)


def _task_of(record):
    from gvla2.episode.lessons import memory_task

    return memory_task(record)


def test_attempts_end_with_the_number_allowed(parts_of):
    parts = parts_of(*QUICK, "memory=none")
    clumsy = Clumsy(parts.planner, times=5)
    record = run_episode(replace(parts, planner=clumsy), EpisodeRequest(seed=1, replan=2))
    assert record.failure.kind == "not_achieved"
    assert len(record.attempts) == 2
    assert [len(each.attempts) for each in record.attempts] == [0, 0]
    assert record.success_check is not None


def test_an_attempt_that_comes_to_nothing_leaves_the_one_before_standing(parts_of):
    parts = parts_of(*QUICK, "memory=none")
    gives_up = Plan(None, abstention=Abstention("other", "I had enough of this."))
    clumsy = Clumsy(parts.planner, then=gives_up)
    record = run_episode(replace(parts, planner=clumsy), EpisodeRequest(seed=1, replan=3))
    assert record.attempts == ()
    assert record.report is not None
    assert (record.failure.kind, record.verdict.outcome) == ("not_achieved", "verified_fail")
    assert any("Attempt 2 ended before anything moved" in n and "had enough" in n for n in record.notes)
    assert len(clumsy.requests) == 2


def misled(parts, overshoot):
    """Memory that recalls a push overshoot that is wrong."""
    effect = Prior("push_overshoot", overshoot, count=1000, skill="push")
    item = MemoryItem("r1", "procedural_hint", "Push on.", 0.9, 0.9, {}, True, effect=effect.to_json())
    return MemoryContext((item,), "Push on.")


def test_what_was_diagnosed_binds_the_next_attempt(parts_of):
    parts = parts_of(*QUICK, "task=push_block", "memory=none")

    class Misleading:
        def recall(self, task):
            return misled(parts, 0.13)

        def learn(self, episode, verdict):
            return parts.memory.learn(episode, verdict)

    record = run_episode(replace(parts, memory=Misleading()), EpisodeRequest(seed=3, replan=1))
    (first,) = record.attempts
    assert first.plan.parameters["push_overshoot"] == pytest.approx(0.13, abs=0.001)
    (bound,) = [e for e in advice_for(record).effects if e.kind == "bound"]
    assert (bound.parameter, bound.op, bound.source) == ("push_overshoot", "<=", "attempt 1")
    assert bound.value < 0.03
    assert record.plan.parameters["push_overshoot"] <= bound.value + 1e-6
    assert any("attempt 1" in note for note in record.plan.notes)
    assert record.verdict.outcome == "verified_success"
    assert record.success_check.relaxed


def test_only_a_camera_that_moved_with_an_empty_hand_sends_the_arm_home():
    seen = inputs.observation(16)
    first, *others = seen.views
    for shift, moved in ((0.01, False), (0.05, True)):
        camera = replace(
            first.camera, world_from_camera=rigid(None, (shift, 0, 0)) @ first.camera.world_from_camera
        )
        after = replace(seen, views=Views((replace(first, camera=camera), *others)))
        assert cameras_moved(seen, after) is moved
    done = WaypointReport(0, "release", (0, 0, 0), (0, 0, 0), 0.0, 0.08, False)
    assert hand_is_free(ExecutionReport((done,)))
    assert hand_is_free(ExecutionReport((replace(done, abort="tracking"),)))
    assert not hand_is_free(ExecutionReport())
    assert not hand_is_free(ExecutionReport((replace(done, held=True),)))
    for stop in ("not_started", "interrupted", "diverged", "expired"):
        assert not hand_is_free(ExecutionReport((replace(done, abort=stop),)))
