"""An arm read off a compiled MuJoCo model."""

import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.robot.kinematics import library
from gvla2.robot.mujoco.description import ArmNames, write_urdf

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
NAMES = ArmNames("base", "hand", ("j1", "j2"), ("f1", "f2"))


def test_its_urdf_moves_as_the_model_does():
    model = mujoco.MjModel.from_xml_string(ARM)
    data, pin = mujoco.MjData(model), library("pinocchio")
    arm = pin.buildModelFromUrdf(str(write_urdf(model, NAMES, speed=1.0)))
    assert {arm.names[k] for k in range(1, arm.njoints)} == {"j1", "j2", "f1", "f2"}
    base = arm.getFrameId("base")
    for joints in ((0.0, 0.0, 0.0, 0.0), (0.7, -0.4, 0.02, 0.03), (-2.0, 1.2, 0.04, 0.01)):
        # Both fingers of the URDF open upwards; the model's second one opens downwards.
        values = dict(zip(("j1", "j2", "f1", "f2"), joints, strict=True))
        for name, value in values.items():
            data.joint(name).qpos[0] = -value if name == "f2" else value
        mujoco.mj_forward(model, data)
        posture = np.array([values[arm.names[k]] for k in range(1, arm.njoints)])
        moved = arm.createData()
        pin.framesForwardKinematics(arm, moved, posture)
        hinges = {"upper": "j1", "lower": "j2"}
        turn, start = data.body("base").xmat.reshape(3, 3), data.body("base").xpos
        for body in ("base", "upper", "lower", "hand", "left", "right"):
            place = moved.oMf[base].inverse() * moved.oMf[arm.getFrameId(body)]
            origin = data.joint(hinges[body]).xanchor if body in hinges else data.body(body).xpos
            np.testing.assert_allclose(place.translation, turn.T @ (origin - start), atol=1e-6)
            np.testing.assert_allclose(place.rotation, turn.T @ data.body(body).xmat.reshape(3, 3), atol=1e-6)


def test_names_that_the_model_lacks_are_said_with_those_that_it_has():
    model = mujoco.MjModel.from_xml_string(ARM)
    with pytest.raises(RobotError, match=r"elbow.*'upper'"):
        write_urdf(model, ArmNames("base", "elbow", ("j1", "j2"), ("f1", "f2")), speed=1.0)
    with pytest.raises(RobotError, match=r"j3.*'j1'"):
        write_urdf(model, ArmNames("base", "hand", ("j1", "j3"), ("f1", "f2")), speed=1.0)
