"""The arm model: kinematics of the Panda, inverse kinematics, straight lines, other URDFs."""

from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import MissingDependencyError, RobotError
from gvla2.geometry.transform import rigid
from gvla2.planning.arm import Hand
from gvla2.planning.scene import Box
from gvla2.robot import urdf
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.collision import CollisionModel
from gvla2.robot.kinematics import Finger, Kinematics


def angle_between(a, b):
    return Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude()


def test_tool_frame_points_out_of_the_hand_and_along_the_fingers(arm):
    tool = arm.forward(arm.home)
    assert tool[2, 2] < -0.9
    model, data = arm.kinematics.model, arm.kinematics.model.createData()
    import pinocchio as pin

    tips = []
    for opening in (0.0, 1.0):
        pin.framesForwardKinematics(model, data, arm.kinematics.full(arm.home, opening))
        tips.append(
            [data.oMf[model.getFrameId(f"panda_{s}finger")].translation.copy() for s in ("left", "right")]
        )
    travel = tips[1][0] - tips[0][0]
    np.testing.assert_allclose(travel, 0.04 * tool[:3, 1], atol=1e-6)
    middle = 0.5 * (tips[1][0] + tips[1][1])
    np.testing.assert_allclose(np.cross(tool[:3, 3] - middle, tool[:3, 2]), 0.0, atol=1e-6)


def test_inverse_reaches_what_forward_says(arm):
    low, high = arm.limits
    targets = [arm.forward(q) for q in np.random.default_rng(7).uniform(low, high, (150, arm.dof))]
    found = [(target, arm.inverse(target)) for target in targets]
    solved = [(target, s) for target, s in found if s is not None]
    assert len(solved) >= 0.95 * len(found)
    for target, solution in solved:
        reached = arm.forward(solution.joints)
        assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) < 5e-4
        assert angle_between(reached, target) < 5e-3
        assert solution.limit_margin >= 0
        assert ((solution.joints >= low) & (solution.joints <= high)).all()
        margin = np.minimum(solution.joints - low, high - solution.joints).min()
        assert solution.limit_margin == pytest.approx(margin)


@pytest.mark.parametrize("place", [(3.0, 0.0, 1.0), (0.775, 0.655, 0.8), (-0.268, 0.0, 0.8)])
def test_out_of_reach_is_none(arm, down, place):
    assert arm.inverse(down(place)) is None


@given(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12), st.floats(-0.1, 0.12), st.floats(-0.4, 0.4))
@settings(max_examples=15, deadline=None)
def test_a_line_is_straight(arm, x, y, z, turn):
    start = arm.inverse(rigid(Rotation.from_euler("x", np.pi).as_matrix(), (0.3, 0.0, 0.95))).joints
    begin = arm.forward(start)
    target = rigid(Rotation.from_rotvec([0, 0, turn]).as_matrix() @ begin[:3, :3], begin[:3, 3] + [x, y, z])
    path = arm.line(start, target, step=0.01)
    assert path is not None
    np.testing.assert_allclose(path[0], start, atol=1e-9)
    np.testing.assert_allclose(arm.forward(path[-1]), target, atol=1e-3)
    places = arm.tool_positions(np.array(path))
    way = np.array([x, y, z])
    if np.linalg.norm(way) > 1e-3:
        shares = (places - begin[:3, 3]) @ way / (way @ way)
        assert (np.diff(shares) > 0).all()
        np.testing.assert_allclose(places, begin[:3, 3] + shares[:, None] * way, atol=5e-4)
    assert np.abs(np.diff(path, axis=0)).max() < 0.2
    assert len(path) >= np.linalg.norm([x, y, z]) / 0.01


SIX = """<robot name="six">
<link name="base"><collision><geometry><box size=".2 .2 .1"/></geometry></collision></link>
{links}
<link name="hand"><collision><origin xyz="0 0 .03"/><geometry><box size=".02 .1 .04"/></geometry></collision></link>
<joint name="wrist" type="fixed"><parent link="l6"/><child link="hand"/></joint>
<link name="finger"><collision><origin xyz="0 .01 0"/><geometry><box size=".02 .02 .04"/></geometry></collision></link>
<joint name="slide" type="prismatic"><origin xyz="0 0 .07"/><parent link="hand"/><child link="finger"/>
<axis xyz="0 1 0"/><limit lower="0" upper=".03" effort="1" velocity="1"/></joint>
</robot>"""
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
LENGTHS = (0.1, 0.0, 0.25, 0.2, 0.05, 0.06)


def six_axes(folder: Path) -> Path:
    links, parent = "", "base"
    for i, (axis, length) in enumerate(zip(AXES, LENGTHS, strict=True), 1):
        links += (
            f'<link name="l{i}"><collision><geometry><sphere radius=".03"/></geometry></collision></link>'
        )
        links += f'<joint name="j{i}" type="revolute"><origin xyz="0 0 {length}"/><parent link="{parent}"/>'
        links += f'<child link="l{i}"/><axis xyz="{axis}"/>'
        links += '<limit lower="-2.5" upper="2.5" effort="9" velocity="2"/></joint>'
        parent = f"l{i}"
    path = folder / "six.urdf"
    path.write_text(SIX.format(links=links))
    return path


def six_arm(urdf: Path, tcp_frame="hand", thumb="slide", home=(0.0, 0.4, 0.8, 0.0, 0.6, 0.0)) -> ArmModel:
    kinematics = Kinematics(
        urdf,
        world_from_base=rigid(Rotation.from_euler("z", 0.5).as_matrix(), (1.0, 2.0, 0.5)),
        tcp_frame=tcp_frame,
        frame_from_tcp=rigid(None, (0, 0, 0.08)),
        fingers=(Finger(thumb, 0.0, 0.03),),
    )
    collisions = CollisionModel(kinematics, urdf, [], hand_links=("hand", "finger"))
    hand, space = Hand(0.03, 0.04, 0.02, 0.02, 0.01, 0.1, 0.02), Box(np.zeros(3), np.full(3, 3.0))
    return ArmModel(kinematics, collisions, hand=hand, home=home, workspace=space)


def test_a_six_axis_arm_of_primitives_without_srdf(tmp_path, scene_of, block):
    six = six_arm(six_axes(tmp_path))
    assert six.dof == 6
    straight = six.forward(np.zeros(6))
    np.testing.assert_allclose(straight[:3, 3], [1.0, 2.0, 0.5 + sum(LENGTHS) + 0.08], atol=1e-9)
    target = six.forward(six.home + 0.2)
    np.testing.assert_allclose(six.forward(six.inverse(target).joints), target, atol=5e-4)
    scene = scene_of(block(at=(1.0, 2.0, 1.3), size=(0.1, 0.1, 0.1)), table=0.45)
    assert six.clearance(np.zeros(6), 0.0, scene).distance < 0
    assert six.clearance(six.home, 0.0, scene).distance > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tcp_frame": "nose"}, "no frame 'nose'"),
        ({"thumb": "thumb"}, "no joint"),
        ({"home": [0.0] * 5}, "home joints"),
        ({"home": [9.0] * 6}, "home joints"),
    ],
)
def test_what_does_not_fit_the_urdf_is_refused(tmp_path, changes, message):
    with pytest.raises(RobotError, match=message):
        six_arm(six_axes(tmp_path), **changes)


def test_a_description_that_is_not_installed_is_named(monkeypatch):
    def absent(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(urdf, "_files", absent)
    with pytest.raises(MissingDependencyError, match="example-robot-data"):
        urdf.find_file("package://example-robot-data/robots/ur_description/urdf/ur5_robot.urdf", "robot.urdf")
