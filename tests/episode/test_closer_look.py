"""A look from nearer by the camera on the arm, where nothing that is seen is what was asked for."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.episode.closer_look import camera_on_arm, closer_look
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.geometry.camera import Camera
from gvla2.planning.scene import Scene
from gvla2.robot.workcell import TCP_FROM_WRIST
from gvla2.testing import inputs
from tests.quick import QUICK
from tests.skills.scenes import ARM, TABLE, cube, make_object

SEEN = ("perceiver=classical", "robot.image_size=160", "robot.cameras=[front,left_shoulder,wrist]")
FRONT = np.array([1.3, 0.0, TABLE + 0.5])  # opposite the robot


def looked(*objects, seen_from=(FRONT,)):
    """The look at the first of some objects, and the camera there."""
    start = replace(
        inputs.observation(48), world_from_tcp=ARM.forward(ARM.home), joints=ARM.home, gripper=1.0
    )
    scene = Scene(objects, TABLE, ARM.workspace)
    look = closer_look(objects[:1], scene, ARM, start, TCP_FROM_WRIST, seen_from)
    if look is None:
        return None, None
    (pose,) = look.trajectory.poses(start.world_from_tcp)
    return look, Camera.from_fov(1.0, pose @ TCP_FROM_WRIST, 160, 160)


def test_the_camera_sees_the_object_from_near_and_from_the_side_that_the_others_do_not():
    can = make_object("can", "cylinder", (0.4, 0.1, 0.05), (0.06, 0.06, 0.1))
    camera = looked(can)[1]
    uv, depth = camera.project(can.centre)
    np.testing.assert_allclose(uv, [80, 80], atol=1.0)
    assert depth < 0.3
    assert (camera.position - can.centre)[0] < -0.05  # from the robot's side
    second = looked(can, seen_from=(FRONT, camera.position))[1]
    ways = [
        (each.position - can.centre) / np.linalg.norm(each.position - can.centre) for each in (camera, second)
    ]
    assert ways[0] @ ways[1] < np.cos(np.radians(30))


def test_a_side_behind_another_object_is_not_looked_at():
    can = make_object("can", "cylinder", (0.4, 0.1, 0.05), (0.06, 0.06, 0.1))
    wall = make_object("wall", "box", (0.33, 0.1, 0.15), (0.02, 0.5, 0.3))
    look, camera = looked(can, wall)
    assert look is None or camera.position[0] > 0.34


def test_what_is_out_of_reach_is_not_looked_at():
    assert looked(cube("far", (3.0, 0.0)))[0] is None


class Nearsighted:
    """A perceiver whose names are those of its inner one, but only from near."""

    def __init__(self, inner, looks=1):
        self.inner, self.looks, self.nearer = inner, looks, []

    def perceive(self, observation, instruction, workspace):
        self.scene = self.inner.perceive(observation, instruction, workspace)
        blurred = (replace(o, label="object", colour="") for o in self.scene.objects)
        return replace(self.scene, objects=tuple(blurred))

    def to_look_at(self, scene, looks):
        return (
            [o for o in scene.objects if o.label == "object" and o.shape != "region"]
            if looks < self.looks
            else ()
        )

    def look_again(self, scene, closer):
        (view,) = closer.views
        self.nearer.append(view.camera)
        return replace(scene, objects=tuple(self._named(o, view.camera) for o in scene.objects))

    def _named(self, obj, camera):
        shown = camera.inside(camera.project(obj.centre)[0])
        return (
            replace(obj, label=self.scene[obj.id].label, colour=self.scene[obj.id].colour) if shown else obj
        )


def test_an_episode_looks_closer_and_carries_out_what_it_then_understands(parts_of):
    parts = parts_of(*QUICK, *SEEN, "memory=none")
    perceiver = Nearsighted(parts.perceiver)
    record = run_episode(replace(parts, perceiver=perceiver), EpisodeRequest(seed=1))
    assert record.failure is None, record.failure
    assert record.success_check.relaxed
    (camera,) = perceiver.nearer
    theme = record.scene[record.plan.roles["theme"]]
    assert min(np.linalg.norm(camera.position - o.centre) for o in record.scene.objects) < 0.3
    assert any("Looked closer at" in note and theme.label in note for note in record.notes)


@pytest.mark.parametrize("looks", [0, 2])
def test_looks_end_with_what_the_perceiver_wants_and_the_refusal_stays(parts_of, looks):
    parts = parts_of(*QUICK, *SEEN, "memory=none")
    perceiver = Nearsighted(parts.perceiver, looks)
    asked = EpisodeRequest(seed=1, instruction="pick up the zeppelin")
    record = run_episode(replace(parts, perceiver=perceiver), asked)
    assert record.failure.kind == "nothing_matches"
    assert len(perceiver.nearer) <= looks
    assert bool(perceiver.nearer) == bool(looks)


def test_only_a_camera_near_the_tool_is_on_the_arm():
    observation = inputs.observation(48)
    camera = observation.views[0].camera
    there = replace(observation, world_from_tcp=camera.world_from_camera)
    assert camera_on_arm(there).name == camera.name
    away = there.world_from_tcp.copy()
    away[:3, 3] += 5.0
    assert camera_on_arm(replace(observation, world_from_tcp=away)) is None
