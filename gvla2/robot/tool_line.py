"""A straight move of the tool, joint by joint."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.robot.ik import InverseKinematics
from gvla2.robot.kinematics import Kinematics, import_pinocchio

_TURN_STEP = 0.05  # radians of tool rotation a step, when the turn is what is long
_JUMP = (
    8.0  # a joint may move this many radians a metre, or a radian, of tool motion; more is a branch change
)


def trace_line(
    kinematics: Kinematics, ik: InverseKinematics, start: FloatArray, target: FloatArray, step: float
) -> list[FloatArray] | None:
    """Joints (dof,) from ``start`` to the tool pose ``target`` (4, 4): position linear, rotation by slerp.

    None when the line leaves the arm's reach or its joint limits, or when a joint would have to jump.
    """
    pin = import_pinocchio()
    begin = kinematics.forward(start)
    shift = target[:3, 3] - begin[:3, 3]
    turn = Rotation.from_matrix(target[:3, :3] @ begin[:3, :3].T).as_rotvec()
    length, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
    count = max(1, int(np.ceil(max(length / step, angle / _TURN_STEP))))
    limit = _JUMP * (length + angle) / count + 0.01
    path = [np.clip(start, kinematics.low, kinematics.high)]
    rotations = Rotation.from_rotvec(np.linspace(0.0, 1.0, count + 1)[:, None] * turn).as_matrix()
    for k in range(1, count + 1):
        pose = rigid(rotations[k] @ begin[:3, :3], begin[:3, 3] + shift * (k / count))
        joints = ik.track(path[-1], pin.SE3(pose))
        if joints is None or np.abs(joints - path[-1]).max() > limit:
            return None
        path.append(joints)
    return path
