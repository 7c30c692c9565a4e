"""The arm that planning sees: kinematics and collisions of one URDF."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.planning.arm import Attachment, Clearance, Hand, IKSolution
from gvla2.planning.scene import Box, Scene
from gvla2.robot.collision import CollisionChecker, CollisionModel
from gvla2.robot.ik import InverseKinematics
from gvla2.robot.kinematics import Kinematics


class ArmModel:
    """Implements :class:`gvla2.planning.arm.Arm`, plus what motion planning needs. Not safe to share between threads.

    ``home`` (dof,) radians. Raises :class:`RobotError` when it does not fit the joints' limits.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        collisions: CollisionModel,
        *,
        hand: Hand,
        home: ArrayLike,
        workspace: Box,
    ) -> None:
        self._home = np.array(home, dtype=np.float64)
        if self._home.shape != (kinematics.dof,) or kinematics.limit_distance(self._home) < 0:
            raise RobotError(
                f"The home joints {self._home.tolist()} don't fit the {kinematics.dof} joints' limits."
            )
        self.kinematics, self.collisions = kinematics, collisions
        self.ik = InverseKinematics(kinematics, self._home)
        self.hand, self.workspace = hand, workspace

    @property
    def home(self) -> FloatArray:
        """(dof,) resting joints, radians."""
        return self._home.copy()

    @property
    def dof(self) -> int:
        """Number of the arm's joints, without fingers."""
        return self.kinematics.dof

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper joint limits (dof,), radians, the margin taken off."""
        return self.kinematics.low, self.kinematics.high

    @property
    def velocity_limits(self) -> FloatArray:
        """(dof,) largest joint speeds of the URDF, rad/s."""
        return self.kinematics.velocity

    def forward(self, joints: FloatArray) -> FloatArray:
        """world_from_tcp (4, 4) at joints (dof,), radians."""
        return self.kinematics.forward(joints)

    def tool_positions(self, joints: FloatArray) -> FloatArray:
        """(N, 3) tool positions at joints (N, dof), metres, world."""
        return self.kinematics.positions(joints)

    def inverse(self, world_from_tcp: FloatArray, near: FloatArray | None = None) -> IKSolution | None:
        """The solution nearest to ``near`` within 0.5 mm and 0.005 rad; None when out of reach."""
        return self.ik.solve(world_from_tcp, near)

    def checker(
        self,
        scene: Scene,
        gripper: float,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> CollisionChecker:
        """Many configurations against one scene; the arguments are those of :meth:`clearance`."""
        return self.collisions.checker(scene, gripper, allowed_contacts, attached)

    def clearance(
        self,
        joints: FloatArray,
        gripper: float,
        scene: Scene,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> Clearance:
        """Smallest distance of the arm to itself and the scene, metres; links go by their URDF names."""
        checker = self.checker(scene, gripper, allowed_contacts, attached)
        return checker.clearance(np.asarray(joints, dtype=np.float64))

    def line(
        self, start: FloatArray, world_from_tcp: FloatArray, step: float = 0.01
    ) -> Sequence[FloatArray] | None:
        """Joints, ``start`` first, every ``step`` metres of a straight tool move; None if impossible."""
        target = check_rigid(world_from_tcp, "target pose")
        return self.ik.line(np.asarray(start, dtype=np.float64), target, step)
