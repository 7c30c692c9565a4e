"""Layouts as third parties write them: joints, shapes, and what is refused."""

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import rigid
from gvla2.planning.colours import COLOURS
from gvla2.robot.task import Body, Joint, Layout, Primitive, TaskInstance
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots

TABLE_HEIGHT = SapienPandaConfig().table_height


@pytest.fixture(scope="module")
def panda():
    component = gvla2_robots()[0]
    robot = component.build(SapienPandaConfig(image_size=128))
    yield robot
    robot.close()


class Laid:
    """A task that is just a layout."""

    instructions = ("a", "b", "c", "d")

    def __init__(self, *bodies: Body, joints: tuple[Joint, ...] = ()):
        self.layout = Layout(bodies, joints)

    def sample(self, rng, site, instruction=None):
        never = {"relaxed": lambda world: False, "strict": lambda world: False}
        return TaskInstance("-", self.layout, never)


def cube(name: str, xyz, size=0.05, **more) -> Body:
    return Body(name, (Primitive("box", (size,) * 3, COLOURS["blue"]),), rigid(translation=xyz), **more)


def hinge(**more) -> Joint:
    what = {
        "axis": np.array([0.0, 1.0, 0.0]),
        "origin": np.array([0.4, 0.0, 1.0]),
        "limits": (-0.2, 1.0),
    }
    return Joint("hinge", "revolute", "post", "arm", **{**what, **more})


def test_hinges_turn_about_their_axis_up_to_their_stop(panda):
    post = cube("post", (0.4, 0.0, 1.0), 0.02, fixed=True)
    arm = cube("arm", (0.5, 0.0, 1.0), 0.04)
    panda.reset(Laid(post, arm, joints=(hinge(damping=0.02),)), 0)
    for _ in range(600):
        panda._world.step()
    # It falls about +y from x to -z: a positive turn, up to the stop.
    assert panda._world.travel("hinge") == pytest.approx(1.0, abs=0.01)
    assert panda._world.peaks["hinge"] == pytest.approx(1.0, abs=0.02)
    end = np.array([0.4 + 0.1 * np.cos(1.0), 0.0, 1.0 - 0.1 * np.sin(1.0)])
    np.testing.assert_allclose(panda._world.body_pose("arm")[:3, 3], end, atol=0.002)


def test_chains_start_at_rest_and_keep_their_names(panda):
    post = cube("post", (0.4, 0.0, 1.0), 0.02, fixed=True)
    arm = cube("arm", (0.5, 0.0, 1.0), 0.04)
    tip = cube("tip", (0.6, 0.0, 1.0), 0.02, mass=0.01)
    slide = Joint(
        "slide", "prismatic", "arm", "tip", np.array([1.0, 0, 0]), np.array([0.6, 0, 1.0]), (0.0, 0.05),
        rest=0.03, stiffness=500.0, damping=5.0,
    )  # fmt: skip
    panda.reset(Laid(tip, post, arm, joints=(slide, hinge(stiffness=50.0, damping=2.0, rest=0.0))), 0)
    assert panda._world.travel("slide") == pytest.approx(0.03, abs=0.002)
    # The slide follows the hinge's turn; what sags is what its spring gives.
    off = panda._world.body_pose("tip")[:3, 3] - (0.63, 0.0, 1.0)
    assert np.linalg.norm(off) < 0.02
    assert abs(panda._world.travel("hinge")) < 0.06


@pytest.mark.parametrize(
    ("bodies", "joints", "message"),
    [
        ([cube("a", (0.3, 0, 0.8)), cube("a", (0.5, 0, 0.8))], (), "two bodies of one name"),
        ([cube("post", (0.3, 0, 0.8))], (hinge(),), "ties 'post' to 'arm'"),
        ([cube("post", (0.3, 0, 0.8)), cube("arm", (0.5, 0, 0.8))], (hinge(), hinge()), "two joints"),
        (
            [cube("post", (0.3, 0, 0.8)), cube("arm", (0.5, 0, 0.8))],
            (hinge(), Joint("back", "revolute", "arm", "post", np.eye(3)[0], np.zeros(3), (0, 1))),
            "ring",
        ),
        (
            [Body("ghost", (Primitive("box", (0.1,) * 3, (0, 0, 0), collides=False),), np.eye(4))],
            (),
            "nothing of it is solid",
        ),
    ],
)
def test_unsound_layouts_are_refused(panda, bodies, joints, message):
    with pytest.raises(ConfigurationError, match=message):
        panda.reset(Laid(*bodies, joints=joints), 0)
    assert panda.reset(None, 0) is None


def test_cylinders_stand_and_spheres_are_round(panda):
    stand = Primitive("cylinder", (0.04, 0.04, 0.10), (1, 0, 0))
    bottle = Body("bottle", (stand,), rigid(translation=(0.3, 0.1, TABLE_HEIGHT + 0.05)), mass=0.2)
    ball = Body(
        "ball",
        (Primitive("sphere", (0.06,) * 3, (0, 0, 1)),),
        rigid(translation=(0.3, -0.1, TABLE_HEIGHT + 0.03)),
    )
    panda.reset(Laid(bottle, ball), 0)
    np.testing.assert_allclose(panda._world.body_pose("bottle"), bottle.world_from_body, atol=1e-3)
    assert panda._world.body_pose("ball")[2, 3] == pytest.approx(TABLE_HEIGHT + 0.03, abs=1e-3)
    points = np.concatenate([v.points()[~v.robot_mask] for v in panda.observe().views])
    high = points[:, 2] > TABLE_HEIGHT + 0.003
    assert points[high & (points[:, 1] > 0), 2].max() == pytest.approx(TABLE_HEIGHT + 0.10, abs=1e-3)
    round_ones = points[high & (points[:, 1] < 0)] - (0.3, -0.1, TABLE_HEIGHT + 0.03)
    assert len(round_ones) > 20
    np.testing.assert_allclose(np.linalg.norm(round_ones, axis=1), 0.03, atol=1e-3)
