"""Guarded moves in the simulation: what the hand feels, and where it stops."""

import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Guard, Orientation, Trajectory, Waypoint
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots

TABLE, SIZE, MASS = 0.752, 0.05, 0.356
TOP = TABLE + SIZE
DOWN = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))


class Block:
    """A task that is one block on the table."""

    instructions = ("a", "b", "c", "d")

    def sample(self, rng, site, instruction=None):
        solid = Primitive("box", (SIZE,) * 3, (0.1, 0.2, 0.8))
        body = Body("block", (solid,), rigid(translation=(0.3, 0.0, TABLE + SIZE / 2)), MASS)
        return TaskInstance("-", Layout((body,)), {"relaxed": lambda w: False, "strict": lambda w: False})


@pytest.fixture(scope="module")
def panda():
    component = next(c for c in gvla2_robots() if c.name == "sapien_panda")
    robot = component.build(SapienPandaConfig(image_size=32, cameras=["front"]))
    yield robot
    robot.close()


def run(panda, *waypoints):
    panda.reset(Block(), 0)
    return panda.execute(Trajectory(waypoints), Scene((), TABLE - 0.2, panda.arm.workspace))


def press(panda, depth, guard):
    above = TOP + panda.arm.hand.tip_beyond_tcp
    return run(
        panda,
        Waypoint((0.3, 0.0, above + 0.05), 0.0, "approach", DOWN),
        Waypoint((0.3, 0.0, above - depth), 0.0, "press", motion="linear", speed=0.05, guard=guard),
        Waypoint((0.3, 0.0, above + 0.05), 0.0, "retreat", motion="linear", guard=Guard(force=25.0)),
    )


@pytest.mark.parametrize("guard", [Guard(force=20.0), Guard(stall=0.003)], ids=["force", "stall"])
def test_the_hand_stops_on_what_does_not_give_way(panda, guard):
    report = press(panda, 0.015, guard)
    assert report.completed, report.abort
    pressed, back = report.waypoints[1:]
    assert pressed.status == "guarded"
    assert pressed.message
    met = TOP + panda.arm.hand.tip_beyond_tcp
    assert abs(pressed.reached[2] - met) < 0.004
    if guard.force:
        assert 20.0 < pressed.force < 60.0
    assert back.status == "linear"  # in the open nothing is felt
    assert back.error < 0.002
