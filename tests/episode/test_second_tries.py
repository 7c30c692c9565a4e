"""Second tries of an object that the hand missed or lost, with the real simulator, planner and verifier."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gvla2.episode.attempts import calls_left, remaining_program, should_try_again, with_covered
from gvla2.episode.loop import EpisodeRequest, SilentListener, run_episode
from gvla2.geometry.transform import rigid
from gvla2.memory.contracts import Verdict
from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Advice, Plan, PlanRequest, Tried
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.record.recorder import RunRecorder
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.skills.carry_out import carry_out
from tests.quick import QUICK


class Mistaken:
    """A perceiver whose first look has every object some centimetres beside its place."""

    def __init__(self, perceiver):
        self._perceiver, self.looks = perceiver, 0

    def perceive(self, observation, instruction, workspace):
        self.looks += 1
        scene = self._perceiver.perceive(observation, instruction, workspace)
        beside = rigid(None, (0.0, 0.09, 0.0))
        objects = (
            replace(o, world_from_object=beside @ o.world_from_object, points=o.points + beside[:3, 3])
            for o in scene.objects
        )
        return replace(scene, objects=tuple(objects)) if self.looks == 1 else scene


class Counted:
    """A planner that counts its answers."""

    def __init__(self, planner):
        self._planner, self.asked = planner, 0

    def plan(self, request):
        self.asked += 1
        return self._planner.plan(request)


@pytest.fixture
def missing(parts_of):
    """The components of a run whose hand misses its object at first."""
    parts = parts_of(*QUICK, "memory=none")
    return replace(parts, perceiver=Mistaken(parts.perceiver), planner=Counted(parts.planner))


def test_a_missed_object_is_tried_again_without_the_planner_and_that_is_reported(missing, tmp_path):
    recorder = RunRecorder(tmp_path, "")
    listener = SilentListener()
    listener.stage = recorder.stage
    record = run_episode(missing, EpisodeRequest(seed=1), listener)
    recorder.finish(record)
    (first,) = record.attempts
    assert (first.report.abort.abort, first.report.abort.stage) == ("slipped", "close")
    assert missing.planner.asked == 1
    assert record.second_tries == 1
    assert (record.verdict.outcome, record.success_check.relaxed) == ("verified_success", True)
    assert any("closed on nothing" in note for note in record.notes)
    written = json.loads((tmp_path / "result.json").read_text())
    assert (written["second_tries"], written["success"], len(written["attempts"])) == (1, True, 2)
    assert "in another way" in (tmp_path / "index.html").read_text()


@pytest.mark.parametrize(
    ("request_", "left", "told"),
    [(EpisodeRequest(seed=1, second_tries=0), 99.0, False), (EpisodeRequest(seed=1), 0.5, True)],
)
def test_no_second_try_where_none_is_allowed_or_the_worlds_time_is_too_short(
    missing, monkeypatch, request_, left, told
):
    monkeypatch.setattr(type(missing.robot), "seconds_left", lambda robot: left, raising=False)
    record = run_episode(missing, request_)
    assert (record.attempts, record.second_tries) == ((), 0)
    assert record.failure.kind == "slipped"
    assert any("this world ends in 0.5 s" in note for note in record.notes) is told


def test_only_a_sure_failure_with_an_empty_hand_is_tried_again(missing):
    missed = run_episode(missing, EpisodeRequest(seed=1, second_tries=0))
    assert should_try_again(missed)

    def ended(abort, outcome, held=False):
        last = replace(missed.report.waypoints[-1], abort=abort, held=held)
        report = replace(missed.report, waypoints=(*missed.report.waypoints[:-1], last))
        return replace(missed, report=report, verdict=Verdict(outcome, 0.5, 1.0, {}, (), "given"))

    assert should_try_again(ended("slipped", "uncertain"))
    assert should_try_again(ended("", "verified_fail"))
    assert not should_try_again(ended("", "uncertain"))
    assert not should_try_again(ended("tracking", "uncertain"))
    assert not should_try_again(ended("expired", "verified_fail"))
    assert not should_try_again(ended("", "verified_fail", held=True))
    # What was lost over its place may lie there.
    theme = missed.after_scene.obstacles()[0]
    (before,) = (o for o in missed.scene.objects if o.label == theme.label)
    for aside, again in ((0.0, False), (0.3, True)):
        x, y, z = theme.centre.tolist()
        ways = [Waypoint((x, y, z), 0.0, "close")]
        ways += [
            Waypoint((x, y + aside, z + 0.1), opening, "release", carries=before.id) for opening in (0.0, 1.0)
        ]
        dropped = replace(missed.plan, trajectory=Trajectory(tuple(ways)))
        assert should_try_again(replace(ended("slipped", "uncertain"), plan=dropped)) is again
    # "10 cm to the left" means something else once it has moved.
    aimed = replace(missed.plan, calls=(SkillCall("place", "o1", direction=(0.1, 0.0)),))
    assert not should_try_again(replace(missed, plan=aimed))


def test_what_was_done_before_an_object_was_lost_is_not_done_again(missing):
    missed = run_episode(missing, EpisodeRequest(seed=1, second_tries=0))
    calls = tuple(SkillCall("place", name, "box", relation="in") for name in ("a", "b", "c"))
    stops = [Waypoint((0.5, 0.0, 0.2), 0.0, "transit", carries=name) for name in ("a", "b", "c")]
    plan = Plan(Trajectory(tuple(stops)), "place", calls=calls, remaining=(SkillCall("pick", "d"),))
    lost = WaypointReport(1, "transit", (0, 0, 0), (0, 0, 0), 0.0, 0.0, False, abort="slipped")
    record = replace(missed, plan=plan, report=ExecutionReport((lost,)))
    assert [call.theme for call in calls_left(record)] == ["b", "c", "d"]
    assert calls_left(replace(record, report=ExecutionReport((replace(lost, abort=""),)))) == ()


def grip(plan, start):
    """The tool's poses where it takes and releases, None if it does not."""
    poses = plan.trajectory.poses(start)
    return [None if k is None else poses[k] for k in plan.trajectory.grips()]


def test_a_grasp_that_failed_is_not_repeated_and_a_place_only_if_the_grasp_is_the_same(parts_of):
    parts = parts_of(*QUICK, "task=put_block", "memory=none")
    sentence = parts.robot.reset(parts.task, 1).instruction
    seen = parts.robot.observe()
    scene = parts.perceiver.perceive(seen, "", parts.robot.arm.workspace)
    request = PlanRequest(sentence, scene, parts.robot.arm, seen.world_from_tcp, seen.joints, seen)
    planned = parts.planner.plan(request)
    calls, first = planned.calls, grip(planned, request.start)
    assert [call.skill for call in calls] == ["place"]

    def again(*tried):
        plan = carry_out(calls, replace(request, advice=Advice(tried=tried)))
        assert plan.trajectory is not None, plan.abstention
        return grip(plan, request.start)

    assert np.allclose(again(), first)
    other = again(Tried(first[0]))
    assert not np.allclose(other[0], first[0], atol=5e-3)
    elsewhere = again(Tried(*first))
    assert not np.allclose(elsewhere, first, atol=5e-3)
    far = first[0].copy()
    far[0, 3] += 0.05
    assert np.allclose(again(Tried(far)), first)


def test_what_lies_under_an_object_that_was_put_on_it_can_still_be_referred_to(parts_of):
    parts = parts_of(*QUICK, "memory=none")
    missed = run_episode(parts, EpisodeRequest(seed=1, second_tries=0))
    theme, *_ = missed.scene.obstacles()
    plate = replace(
        theme, id="plate", label="plate", colour="white", rgb=np.ones(3), shape="disc",
        extents=np.array([0.2, 0.2, 0.02]), world_from_object=rigid(None, (0.5, 0.2, missed.scene.table_height + 0.01)),
    )  # fmt: skip
    before = replace(missed.scene, objects=(theme, plate))
    plan = replace(
        missed.plan, calls=(), remaining=(SkillCall("place", theme.id, "plate", relation="right_of"),)
    )
    part = replace(missed, scene=before, after_scene=None, plan=plan)
    on_it = replace(
        theme, id="o1", world_from_object=rigid(None, (0.5, 0.2, plate.top + 0.5 * theme.extents[2]))
    )
    beside = replace(on_it, world_from_object=rigid(None, (0.2, -0.2, 0.8)))
    for obj, remembered in ((on_it, True), (beside, False)):
        now = with_covered(replace(before, objects=(obj,)), part.afresh(parts=(part,)))
        assert [o.label for o in now.objects[1:]] == ["plate"] * remembered
    after = replace(part.afresh(parts=(part,)), observation=missed.observation)
    scene = with_covered(replace(before, objects=(on_it,)), after)
    (call,) = remaining_program(replace(after, scene=scene)).calls
    assert (call.theme, scene[call.goal].label) == ("o1", "plate")
