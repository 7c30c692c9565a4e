"""Whatever a planner or a perceiver returns: it is well-formed, or the refusal says what is wrong with it."""

import time
from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import PerceptionError, PlannerTimeoutError, PlanningError
from gvla2.planning.asking import ABSURD, ask, perceive
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.trajectory import Guard, Orientation, Trajectory, Waypoint
from gvla2.testing import inputs

GOOD = Waypoint((0.3, 0.0, 0.9), 1.0, "approach", guard=Guard(force=5.0))
NAN = float("nan")


class Says:
    def __init__(self, answer):
        self.answer = answer

    def plan(self, request):
        return self.answer


def planned(*waypoints, **rest):
    return Plan(Trajectory(tuple(waypoints)), "pick", **rest)


def changed(**fields):
    return planned(GOOD, replace(GOOD, **fields))


@pytest.mark.parametrize(
    "plan",
    [
        planned(GOOD, GOOD),
        planned(GOOD, roles={"theme": "a"}, parameters={"lift_height": np.float64(0.2), "n": 3}),
        changed(xyz=[0.3, 0.0, np.float32(0.9)]),
        Plan(None, abstention=Abstention("ambiguous", "Two of them.")),
        planned(*[GOOD] * ABSURD),  # the checks say what is too many
    ],
)
def test_a_plan_passes_as_it_is(plan):
    assert ask(Says(plan), None, "mine") is plan


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (None, "NoneType, not a Plan"),
        (Plan(None), "neither a trajectory nor an abstention"),
        (Plan([GOOD]), "trajectory .*, which is not Trajectory"),
        (Plan(None, abstention="no"), "abstention 'no', which is not Abstention"),
        (planned(), "a trajectory of 0 waypoints"),
        (planned(*[GOOD] * 10_000), "10000 waypoints; give 1 to 20"),
        (planned(GOOD, "up"), r"trajectory.waypoints\[1\] 'up', which is not Waypoint"),
        (changed(xyz=(NAN, 0.0, 0.9)), r"waypoints\[1\].xyz\[0\] nan, which is not a finite number"),
        (changed(xyz=(0.3, 0.9)), "which is not tuple"),
        (changed(gripper=None), "gripper None, which is not a finite number"),
        (changed(allowed_contacts=["a"]), "which is not frozenset"),
        (changed(orientation=Orientation("axis", (NAN, 0.0, 1.0))), "orientation.vector"),
        (changed(guard=Guard(force="much")), "guard.force 'much'"),
        (planned(GOOD, parameters={"lift_height": NAN}), "a finite number"),
        (changed(motion="fly"), "motion 'fly', which is not one of free, linear"),
        (planned(GOOD, candidates=("a",)), "candidates"),
    ],
)
def test_rubbish_is_refused_in_words(answer, words):
    with pytest.raises(PlanningError, match=f"The planner 'mine' returned .*{words}"):
        ask(Says(answer), None, "mine")


def test_a_planner_that_hangs_is_named_and_stopped():
    rounds = []

    class Hangs:
        def plan(self, request):
            while True:
                rounds.append(1)
                time.sleep(0.01)

    with pytest.raises(PlannerTimeoutError, match=r"'mine' gave no answer within 0\.1 s"):
        ask(Hangs(), None, "mine", 0.1)
    time.sleep(0.2)
    before = len(rounds)
    time.sleep(0.2)
    assert len(rounds) == before


@pytest.mark.parametrize("seconds", [0.0, 5.0])
def test_answers_and_errors_pass_through_a_time_limit(seconds):
    class Waits:
        def plan(self, request):
            raise TimeoutError("the endpoint")

    assert ask(Says(planned(GOOD)), None, "mine", seconds) == planned(GOOD)
    with pytest.raises(TimeoutError, match="the endpoint"):
        ask(Waits(), None, "mine", seconds)


WHO = "The perceiver 'mine' of plugin 'yours'"


class Perceiver:
    def __init__(self, answer):
        self.answer = answer

    def perceive(self, observation, instruction, workspace):
        return self.answer


def scene_with(**fields):
    scene = inputs.scene()
    return replace(scene, objects=(replace(scene.objects[0], **fields), *scene.objects[1:]))


def perceived(answer):
    return perceive(Perceiver(answer), inputs.observation(8), "", inputs.WORKSPACE, WHO)


@pytest.mark.parametrize(
    ("answer", "reported"),
    [
        (None, "must be Scene, got NoneType"),
        (replace(inputs.scene(), objects=inputs.scene().objects[:1] * 2), "Ids of objects must be unique"),
        (replace(inputs.scene(), table_height=float("nan")), "table_height must be finite"),
        (scene_with(world_from_object=np.full((4, 4), np.nan)), "'red_cube': world_from_object has entries"),
        (scene_with(extents=np.full(3, np.nan)), "'red_cube': extents has entries that are not finite"),
        (scene_with(extents=np.full(3, -1.0)), "'red_cube': extents must not be negative"),
    ],
)  # fmt: skip
def test_what_is_no_scene_is_reported_with_its_perceiver(answer, reported):
    with pytest.raises(PerceptionError, match=f"{WHO} gave no valid scene. .*{reported}"):
        perceived(answer)


def test_a_scene_is_handed_on_read_only():
    given = scene_with(points=np.zeros((5, 3)))
    scene = perceived(given)
    assert [o.id for o in scene.objects] == [o.id for o in given.objects]
    assert not scene.objects[0].points.flags.writeable
    assert given.objects[0].points.flags.writeable
