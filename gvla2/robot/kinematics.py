"""Forward kinematics of an arm from its URDF, in the world frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import MissingDependencyError, RobotError
from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.robot.descent import chain_of

_PURPOSES = {
    "pinocchio": "An arm's kinematics",
    "coal": "Collision checking",
    "ompl": "Motion planning",
}


def library(name: str) -> Any:
    """The optional module ``name``, such as "coal" or "ompl.base".

    Raises :class:`MissingDependencyError` when it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        purpose = _PURPOSES[name.partition(".")[0]]
        raise MissingDependencyError(name, purpose, 'pip install "gvla2[sim]"') from error


@dataclass(frozen=True)
class Finger:
    """A finger's joint by name, and its travel with the gripper ``closed`` and ``opened`` (metres or radians)."""

    joint: str
    closed: float
    opened: float


class Kinematics:
    """An arm of single-axis joints: joint limits, tool pose, Jacobian.

    ``world_from_base`` (4, 4) places the URDF's root; ``tcp_frame`` names a frame of the URDF and ``frame_from_tcp``
    (4, 4) the tool centre point in it. Joints are the URDF's movable ones except the fingers', in its order.
    ``limit_margin`` (radians) is kept free at both ends of each joint's range. Not safe to share between threads.
    Raises :class:`RobotError` for a URDF that does not fit.
    """

    def __init__(
        self,
        urdf: Path,
        *,
        world_from_base: FloatArray,
        tcp_frame: str,
        frame_from_tcp: FloatArray,
        fingers: Sequence[Finger] = (),
        limit_margin: float = 0.01,
    ) -> None:
        self._pin = pin = library("pinocchio")
        if not urdf.is_file():
            raise RobotError(f"No robot description at {urdf}.")
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.world_from_base: FloatArray = check_rigid(world_from_base, "world_from_base")
        _place_base(self.model, pin.SE3(self.world_from_base))
        joints = list(self.model.names)[1:]
        missing = [f.joint for f in fingers if f.joint not in joints]
        if missing:
            raise RobotError(f"{urdf.name} has no joint {missing}; it has {joints}.")
        if any(joint.nq != 1 for joint in list(self.model.joints)[1:]):
            raise RobotError(
                f"{urdf.name} has a joint without limits or with several axes, which is not supported."
            )
        if not self.model.existFrame(tcp_frame):
            raise RobotError(f"{urdf.name} has no frame '{tcp_frame}'.")
        frame = self.model.frames[self.model.getFrameId(tcp_frame)]
        if frame.parentJoint == 0:
            raise RobotError(
                f"No joint of {urdf.name} moves the tool's link '{tcp_frame}'; name one behind the arm's last joint."
            )
        names = {f.joint for f in fingers}
        self.joint_names = tuple(name for name in joints if name not in names)
        self.arm_index = np.array([self._column(name) for name in self.joint_names])
        self._finger_index = np.array([self._column(f.joint) for f in fingers], dtype=np.intp)
        self._closed = np.array([f.closed for f in fingers])
        self._opened = np.array([f.opened for f in fingers])

        self.tcp_joint: int = frame.parentJoint
        self.joint_from_tcp: FloatArray = frame.placement.homogeneous @ check_rigid(frame_from_tcp, "tcp")
        locked = [self.model.getJointId(f.joint) for f in fingers]
        self._arm = pin.buildReducedModel(self.model, locked, pin.neutral(self.model))
        tool_joint = self._arm.getJointId(self.model.names[self.tcp_joint])
        self._tcp = self._arm.addFrame(
            pin.Frame("gvla2_tcp", tool_joint, 0, pin.SE3(self.joint_from_tcp), pin.FrameType.OP_FRAME)
        )
        self._data = self._arm.createData()

        self.low: FloatArray = np.array(self._arm.lowerPositionLimit) + limit_margin
        self.high: FloatArray = np.array(self._arm.upperPositionLimit) - limit_margin
        self.velocity: FloatArray = np.array(self._arm.velocityLimit)
        if not (np.isfinite(self.low) & np.isfinite(self.high) & (self.low < self.high)).all():
            raise RobotError(f"{urdf.name} has joints without usable limits.")
        self.chain = chain_of(self._arm, self._tcp, self.low, self.high)

    def _column(self, name: str) -> int:
        return int(self.model.joints[self.model.getJointId(name)].idx_q)

    @property
    def dof(self) -> int:
        """Number of the arm's joints, without fingers."""
        return len(self.joint_names)

    def full(self, joints: FloatArray, gripper: float) -> FloatArray:
        """All of the URDF's joints (nq,) for the arm's (dof,) and an opening in [0, 1]."""
        q = np.empty(self.model.nq)
        q[self.arm_index] = joints
        q[self._finger_index] = self._closed + gripper * (self._opened - self._closed)
        return q

    def link_poses(self, joints: FloatArray, gripper: float) -> dict[str, FloatArray]:
        """world_from_link (4, 4) of every link by its name, at joints (dof,) and an opening in [0, 1]."""
        data = self.model.createData()
        self._pin.framesForwardKinematics(self.model, data, self.full(joints, gripper))
        links = ((i, f) for i, f in enumerate(self.model.frames) if f.type == self._pin.FrameType.BODY)
        return {str(frame.name): np.array(data.oMf[index].homogeneous) for index, frame in links}

    def pose(self, joints: FloatArray) -> Any:
        """world_from_tcp as a pinocchio SE3."""
        self._pin.forwardKinematics(self._arm, self._data, joints)
        return self._pin.updateFramePlacement(self._arm, self._data, self._tcp)

    def forward(self, joints: FloatArray) -> FloatArray:
        """world_from_tcp (4, 4) at joints (dof,)."""
        return np.array(self.pose(np.asarray(joints, dtype=np.float64)).homogeneous)

    def positions(self, joints: FloatArray) -> FloatArray:
        """(N, 3) tool positions at joints (N, dof), metres, world."""
        return np.array([self.pose(row).translation for row in joints]).reshape(-1, 3)

    def manipulability(self, joints: FloatArray) -> float:
        """sqrt(det(J J^T)) (Yoshikawa), 0 at a singularity."""
        joints = np.asarray(joints, dtype=np.float64)
        jacobian = self._pin.computeFrameJacobian(self._arm, self._data, joints, self._tcp)
        return float(np.sqrt(max(0.0, np.linalg.det(jacobian @ jacobian.T))))

    def limit_distance(self, joints: FloatArray) -> float:
        """Smallest distance to a joint limit, radians; negative outside."""
        return float(np.minimum(joints - self.low, self.high - joints).min())


def _place_base(model: Any, base: Any) -> None:
    """Move everything attached to the model's root by the SE3 ``base``, so that kinematics are in the world frame."""
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            model.jointPlacements[joint] = base * model.jointPlacements[joint]
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == 0 and index > 0:
            frame.placement = base * frame.placement
