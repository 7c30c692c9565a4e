"""A straight move of the tool, joint by joint."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.robot.ik import InverseKinematics
from gvla2.robot.kinematics import Kinematics

_TURN_STEP = 0.05  # radians of tool rotation per step, if rotation dominates
_JUMP = 0.1  # radians a joint may move in a step; beyond, the step is halved: fast swings pass, branch changes don't
_HALVINGS = 4


def trace_line(
    kinematics: Kinematics, ik: InverseKinematics, start: FloatArray, target: FloatArray, step: float
) -> list[FloatArray] | None:
    """Joints (dof,) from ``start`` to the tool pose ``target`` (4, 4): position linear, rotation by slerp.

    Points are at most ``step`` metres apart, closer where a joint swings fast.
    None when the line leaves the arm's reach or its joint limits, or when a joint would have to jump.
    """
    begin = kinematics.forward(start)
    shift = target[:3, 3] - begin[:3, 3]
    turn = Rotation.from_matrix(target[:3, :3] @ begin[:3, :3].T).as_rotvec()
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / max(angle, 1e-12)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    once, twice = across @ begin[:3, :3], across @ across @ begin[:3, :3]

    def along(share: float) -> FloatArray:
        sine, versine = np.sin(share * angle), 1.0 - np.cos(share * angle)
        return rigid(begin[:3, :3] + sine * once + versine * twice, begin[:3, 3] + share * shift)

    steps = max(np.linalg.norm(shift) / step, np.linalg.norm(turn) / _TURN_STEP)
    count = max(1, int(np.ceil(steps - 1e-9)))
    path = [np.clip(start, kinematics.low, kinematics.high)]
    at, size = 0.0, 1.0 / count
    while at < 1.0 - 1e-9:
        to = min(1.0, at + size)
        joints = ik.track(path[-1], along(to))
        if joints is not None and np.abs(joints - path[-1]).max() <= _JUMP:
            path.append(joints)
            at, size = to, min(2.0 * size, 1.0 / count)
        elif size * count > 0.5**_HALVINGS + 1e-9:
            size *= 0.5
        else:
            return None
    return path
