"""Threads, true state and true scene, with real physics."""

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.task import Body, Primitive, Thread
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots
from tests.plugins.tabletop_layouts import Laid

TABLE_HEIGHT = SapienPandaConfig().table_height

UP = np.array([0.0, 0.0, 1.0])
GREEN, GREY = (0.0, 0.5, 0.0), (0.5, 0.5, 0.5)


@pytest.fixture(scope="module")
def panda():
    robot = gvla2_robots()[0].build(SapienPandaConfig(image_size=64))
    yield robot
    robot.close()


def jar(**more) -> Laid:
    height = TABLE_HEIGHT + 0.05
    pot = Body(
        "pot",
        (Primitive("cylinder", (0.06, 0.06, 0.10), GREEN),),
        rigid(translation=(0.3, 0, height)),
        fixed=True,
    )
    lid = Body(
        "lid",
        (Primitive("cylinder", (0.07, 0.07, 0.02), GREY),),
        rigid(translation=(0.3, 0, height + 0.06)),
        0.05,
    )
    what = {"release": 1.4, "limits": (0.0, np.pi), **more}
    return Laid(pot, lid, threads=(Thread("thread", "pot", "lid", UP, lid.world_from_body[:3, 3], **what),))


def push(panda, body: str, seconds: float, force=(0, 0, 0), torque=(0, 0, 0)) -> None:
    (rigid_body,) = [
        c for c in panda._world._bodies.entities[body].components if hasattr(c, "add_force_torque")
    ]
    for _ in range(int(seconds * 240)):
        rigid_body.add_force_torque(np.float32(force), np.float32(torque))
        panda._world.step()


def test_a_lid_turns_on_its_thread_and_does_not_come_off_before(panda):
    panda.reset(jar(), 0)
    state = panda.true_state()
    push(panda, "lid", 0.3, force=(0.0, 0.0, 5.0))
    assert state.pose("lid")[2, 3] == pytest.approx(TABLE_HEIGHT + 0.11, abs=1e-3)
    push(panda, "lid", 0.5, torque=(0.0, 0.0, -0.05))
    assert state.joint("thread") == pytest.approx(0.0, abs=0.05)  # the stop
    push(panda, "lid", 0.2, torque=(0.0, 0.0, 0.05))
    assert 0.1 < state.joint("thread") < 1.4
    assert state.peak("thread") >= state.joint("thread")
    assert not state.loose("thread")


def test_a_lid_turned_far_enough_is_free(panda):
    panda.reset(jar(), 0)
    state = panda.true_state()
    push(panda, "lid", 1.5, torque=(0.0, 0.0, 0.05))
    assert state.loose("thread")
    assert state.peak("thread") == pytest.approx(1.4, abs=0.1)
    push(panda, "lid", 0.3, force=(0.0, 0.0, 2.0))
    assert state.pose("lid")[2, 3] > TABLE_HEIGHT + 0.15
    assert panda.reset(jar(), 0) is not None
    assert not panda.true_state().loose("thread")


def test_a_thread_of_more_than_half_a_turn_holds_to_its_end_and_keeps_its_stop(panda):
    panda.reset(jar(limits=(0.0, 2 * np.pi), release=4.5), 0)
    state = panda.true_state()
    push(panda, "lid", 0.5, torque=(0.0, 0.0, -0.05))
    assert state.joint("thread") == pytest.approx(0.0, abs=0.05)  # the stop
    while state.joint("thread") < 4.0:
        before = state.joint("thread")
        push(panda, "lid", 0.05, torque=(0.0, 0.0, 0.02))
        assert state.joint("thread") > before
    assert not state.loose("thread")
    push(panda, "lid", 0.3, force=(0.0, 0.0, 2.0))
    assert state.pose("lid")[2, 3] == pytest.approx(TABLE_HEIGHT + 0.11, abs=1e-3)
    while not state.loose("thread"):
        push(panda, "lid", 0.05, torque=(0.0, 0.0, 0.02))
        assert state.joint("thread") < 5.0


def test_a_lid_that_is_tipped_stays_upright_on_its_thread(panda):
    panda.reset(jar(limits=(0.0, 2 * np.pi), release=4.5), 0)
    state = panda.true_state()
    push(panda, "lid", 0.2, torque=(0.0, 0.0, 0.05))
    for _ in range(20):
        push(panda, "lid", 0.02, force=(0.0, 0.0, 20.0), torque=(3.0, 0.0, 0.0))
        assert state.pose("lid")[2, 2] > np.cos(np.deg2rad(3.0))
    push(panda, "lid", 0.1)
    np.testing.assert_allclose(state.pose("lid")[:3, 2], UP, atol=0.02)
    assert not state.loose("thread")


def block(xyz, size=0.05, **more) -> Body:
    return Body("block", (Primitive("box", (size,) * 3, GREEN),), rigid(translation=xyz), **more)


def squeeze(robot, xyz) -> None:
    down = Orientation("grasp", (0, 0, -1), (0, 1, 0))
    near = frozenset({"block", "table"})
    above = (xyz[0], xyz[1], xyz[2] + 0.1)
    steps = (
        Waypoint(above, 1.0, "approach", down),
        Waypoint(xyz, 1.0, "reach", motion="linear", allowed_contacts=near),
        Waypoint(xyz, 0.0, "grasp", motion="linear", allowed_contacts=near),
    )
    report = robot.execute(Trajectory(steps), Scene((), TABLE_HEIGHT, robot.arm.workspace))
    assert report.completed, report.abort


def test_a_new_execution_does_not_let_go_of_what_is_held(panda):
    place = (0.35, 0.1, TABLE_HEIGHT + 0.025)
    panda.reset(Laid(block(place)), 0)
    squeeze(panda, place)
    up = (place[0], place[1], place[2] + 0.1)
    lift = Waypoint(up, 0.0, "lift", motion="linear", allowed_contacts=frozenset({"table"}))
    hold = Waypoint(up, 0.0, "hold", motion="linear")
    report = panda.execute(Trajectory((lift, hold)), Scene((), TABLE_HEIGHT, panda.arm.workspace))
    assert report.completed
    assert panda.true_state().pose("block")[2, 3] == pytest.approx(place[2] + 0.1, abs=0.003)


def test_the_true_scene_shows_every_body_where_it_is(panda):
    panda.reset(jar(), 0)
    scene = panda.true_scene()
    assert scene.perceiver == "oracle"
    pot, lid = scene["pot"], scene["lid"]
    assert (pot.shape, lid.shape, lid.parent) == ("cylinder", "cylinder", "pot")
    assert (pot.colour, lid.colour) == ("green", "gray")
    np.testing.assert_allclose(pot.extents, (0.06, 0.06, 0.10), atol=1e-6)
    np.testing.assert_allclose(lid.centre, (0.3, 0.0, TABLE_HEIGHT + 0.11), atol=1e-3)
    off = np.linalg.norm(lid.points[:, :2] - lid.centre[:2], axis=1)
    assert off.max() < 0.0351
    assert np.ptp(lid.points[:, 2]) == pytest.approx(0.02, abs=1e-3)
