"""Forward kinematics of an arm, in the world frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from gvla2.errors import MissingDependencyError, RobotError
from gvla2.geometry.transform import FloatArray

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
    """An arm of single-axis joints: joint limits and tool pose.

    ``robot`` is pinocchio's model, read from what errors call ``source``. ``world_from_base`` (4, 4) places its root;
    ``tool_link`` is one of its links and ``link_from_tcp`` (4, 4) the tool centre point in it. Joints are all but the
    fingers', in its order. ``limit_margin`` (radians) is kept free at both ends of each joint's range. ``model`` is in
    the world, with fingers, ``arm`` without. Not safe to share between threads. Raises :class:`RobotError` for a model
    that does not fit.
    """

    def __init__(
        self,
        robot: Any,
        source: str,
        *,
        world_from_base: FloatArray,
        tool_link: str,
        link_from_tcp: FloatArray,
        fingers: Sequence[Finger] = (),
        limit_margin: float = 0.01,
    ) -> None:
        self._pin = pin = library("pinocchio")
        self.model = robot.copy()
        self.world_from_base = world_from_base
        _place_base(self.model, pin.SE3(world_from_base))
        free = [n for n, joint in zip(self.model.names, self.model.joints, strict=True) if joint.nq > 1]
        if free:
            raise RobotError(f"{source}: joints need one axis each; these have several: {', '.join(free)}.")
        frame = self.model.frames[self.model.getFrameId(tool_link)]
        if frame.parentJoint == 0:
            raise RobotError(
                f"No joint of {source} moves the tool's link '{tool_link}'; name one behind the arm's last joint."
            )
        names = {f.joint for f in fingers}
        self.joint_names = tuple(name for name in list(self.model.names)[1:] if name not in names)
        self.arm_index = np.array([self._column(name) for name in self.joint_names])
        self._finger_index = np.array([self._column(f.joint) for f in fingers], dtype=np.intp)
        self._closed = np.array([f.closed for f in fingers])
        self._opened = np.array([f.opened for f in fingers])

        self.tcp_joint: int = frame.parentJoint
        self.joint_from_tcp: FloatArray = frame.placement.homogeneous @ link_from_tcp
        locked = [self.model.getJointId(f.joint) for f in fingers]
        self.arm = pin.buildReducedModel(self.model, locked, pin.neutral(self.model))
        tool_joint = self.arm.getJointId(self.model.names[self.tcp_joint])
        tcp = pin.Frame("gvla2_tcp", tool_joint, 0, pin.SE3(self.joint_from_tcp), pin.FrameType.OP_FRAME)
        self.tcp: int = self.arm.addFrame(tcp)
        self._data = self.arm.createData()

        self.low: FloatArray = np.array(self.arm.lowerPositionLimit) + limit_margin
        self.high: FloatArray = np.array(self.arm.upperPositionLimit) - limit_margin
        self.velocity: FloatArray = np.array(self.arm.velocityLimit)
        if not (np.isfinite(self.low) & np.isfinite(self.high) & (self.low < self.high)).all():
            bad = ~(np.isfinite(self.low) & np.isfinite(self.high) & (self.low < self.high))
            rows = zip(self.joint_names, self.low - limit_margin, self.high + limit_margin, bad, strict=True)
            listing = ", ".join(f"{name} ({low:g} to {high:g})" for name, low, high, wrong in rows if wrong)
            raise RobotError(f"Joints of {source} cannot move within their <limit>: {listing}.")

    def _column(self, name: str) -> int:
        return int(self.model.joints[self.model.getJointId(name)].idx_q)

    @property
    def dof(self) -> int:
        """Number of the arm's joints, without fingers."""
        return len(self.joint_names)

    def full(self, joints: FloatArray, gripper: float) -> FloatArray:
        """All of the model's joints (nq,) for the arm's (dof,) and an opening in [0, 1]."""
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

    def forward(self, joints: FloatArray) -> FloatArray:
        """world_from_tcp (4, 4) at joints (dof,)."""
        self._pin.forwardKinematics(self.arm, self._data, np.asarray(joints, dtype=np.float64))
        return np.array(self._pin.updateFramePlacement(self.arm, self._data, self.tcp).homogeneous)

    def positions(self, joints: FloatArray) -> FloatArray:
        """(N, 3) tool positions at joints (N, dof), metres, world."""
        return np.array([self.forward(row)[:3, 3] for row in joints]).reshape(-1, 3)

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
