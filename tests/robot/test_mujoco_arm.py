"""An arm and cameras read off a compiled MuJoCo model."""

import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.robot.mujoco.arm import ArmNames, arm_from_mjcf
from gvla2.robot.mujoco.world import ModelEyes
from gvla2.robot.options import ArmConfig
from gvla2_plugins.mujoco import MjcfConfig
from gvla2_plugins.mujoco.worlds import MjcfWorld

mujoco = pytest.importorskip("mujoco")

pytestmark = pytest.mark.worlds

ARM = """
<mujoco>
  <worldbody>
    <body name="base" pos="0.3 -0.1 0.5" euler="0 0 30">
      <geom type="cylinder" size="0.05 0.1"/>
      <body name="upper" pos="0 0.02 0.2" euler="10 0 0">
        <joint name="j1" axis="0 0 1" pos="0.01 0 0.03" range="-170 170"/>
        <geom type="box" size="0.03 0.03 0.1" pos="0 0 0.1"/>
        <body pos="0 0 0.2" euler="0 20 0">
          <body name="lower" pos="0.05 0 0">
            <joint name="j2" axis="0 1 0" range="-100 100" ref="15"/>
            <geom type="capsule" size="0.02 0.1" pos="0 0 0.1"/>
            <body name="hand" pos="0 0 0.25" euler="0 0 45">
              <geom type="sphere" size="0.03"/>
              <body name="left" pos="0 0.01 0.05">
                <joint name="f1" type="slide" axis="0 1 0" range="0 0.04" ref="0.01"/>
                <geom type="box" size="0.01 0.005 0.03"/>
              </body>
              <body name="right" pos="0 -0.01 0.05">
                <joint name="f2" type="slide" axis="0 1 0" range="-0.04 0"/>
                <geom type="box" size="0.01 0.005 0.03"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
SERVOS = """<actuator><position joint="j1" kp="99"/><position joint="j2" kp="99"/>
<position name="g1" joint="f1" kp="99" ctrlrange="0 .04"/><position name="g2" joint="f2" kp="99" ctrlrange="0 .04"/>
</actuator></mujoco>"""
NAMES = ArmNames("base", "hand", ("j1", "j2"), ("f1", "f2"))


@pytest.mark.parametrize(
    ("lens", "fx", "fy", "cx", "cy_off"),
    [
        ('fovy="90"', 100, 100, 100, 0),
        ('focal="0.002 0.002" resolution="1280 720" sensorsize="0.004 0.002"', 100, 200, 100, 0),
        # MuJoCo 3.6 turned the sign of the principal point's y.
        (
            'focalpixel="150 150" resolution="200 200" sensorsize="2e-3 2e-3" principalpixel="20 10"',
            150,
            150,
            80,
            10,
        ),
    ],
)
def test_a_cameras_lens_is_the_one_that_draws(lens, fx, fy, cx, cy_off):
    camera = f'<mujoco><worldbody><camera name="c" pos="0 0 1" {lens}/></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(camera)
    mujoco.mj_forward(model, data := mujoco.MjData(model))
    K = ModelEyes(model, data, ["c"], [0]).camera("c", 200).K
    assert [K[0, 0], K[1, 1], K[0, 2]] == pytest.approx([fx, fy, cx], rel=1e-4)
    assert abs(K[1, 2] - 100) == pytest.approx(cy_off, abs=1e-2)


HOME = ArmConfig(home=[0.1, 0.2], table_height=-1.0)


def test_it_moves_as_the_model_does():
    model = mujoco.MjModel.from_xml_string(ARM)
    data, made = mujoco.MjData(model), arm_from_mjcf(model, NAMES, HOME)
    kinematics = made.arm.kinematics
    assert kinematics.joint_names == NAMES.joints
    assert made.arm.hand.max_width == pytest.approx(0.08)
    for joints, opening in (((0.0, 0.0), 0.0), ((0.7, -0.4), 0.5), ((-2.0, 1.2), 1.0)):
        values = dict(zip(("j1", "j2", "f1", "f2"), (*joints, 0.04 * opening, -0.04 * opening), strict=True))
        for name, value in values.items():
            data.joint(name).qpos[0] = value
        mujoco.mj_forward(model, data)
        poses = kinematics.link_poses(np.array(joints), opening)
        for body in ("base", "upper", "lower", "hand", "left", "right"):
            place = data.body(body)
            np.testing.assert_allclose(poses[body][:3, 3], place.xpos, atol=1e-9)
            np.testing.assert_allclose(poses[body][:3, :3], place.xmat.reshape(3, 3), atol=1e-9)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("base", "elbow", ("j1", "j2"), ("f1", "f2")), r"elbow.*'upper'"),
        (("base", "hand", ("j1", "j3"), ("f1", "f2")), r"j3.*'j1'"),
        (("base", "hand", ("j2", "j1"), ("f1", "f2")), r"j1, j2: name them so"),
        (("base", "hand", ("j1",), ("f1", "j2")), r"two sliding joints on one body"),
    ],
)
def test_names_that_do_not_fit_are_said_with_what_the_model_has(names, message):
    model = mujoco.MjModel.from_xml_string(ARM)
    with pytest.raises(RobotError, match=message):
        arm_from_mjcf(model, ArmNames(*names), HOME)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            b'<geom type="sphere" size="0.03"/>',
            b'<geom type="sphere" size=".03" pos="1e308 0 0"/>',
            "blows up",
        ),
        (b'name="upper"', b'name="upp\xbcr"', "UnicodeDecodeError"),
    ],
)
def test_a_file_that_cannot_be_simulated_is_refused_by_name(tmp_path, monkeypatch, old, new, message):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "arm.xml"
    seen = ARM.replace("<worldbody>", '<worldbody><camera name="c" pos="1 0 1"/>')
    path.write_bytes(seen.replace("</mujoco>", SERVOS).encode().replace(old, new))
    config = MjcfConfig(
        mjcf=str(path), base="base", tool="ghost" if b"\xbc" in new else "hand", joints=["j1", "j2"]
    )
    config.cameras, config.fingers, config.gripper_actuators = ["c"], ["f1", "f2"], ["g1", "g2"]
    with pytest.raises(RobotError, match=rf"arm\.xml.*{message}"):
        MjcfWorld(config).begin(0)
    assert [one.name for one in tmp_path.iterdir()] == ["arm.xml"]
