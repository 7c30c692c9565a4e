"""The arm that planning sees: kinematics and collisions of one URDF."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Attachment, Clearance, Hand
from gvla2.planning.scene import Box, Scene
from gvla2.robot.collision import CollisionModel
from gvla2.robot.ik import InverseKinematics
from gvla2.robot.kinematics import Kinematics


class ArmModel:
    """Implements :class:`gvla2.planning.arm.Arm`, plus what motion planning needs. Not safe to share between threads.

    ``limits`` are the lower and upper joint limits (dof,), the margin taken off, and
    ``velocity_limits`` the URDF's joint speeds, rad/s. Raises :class:`RobotError` for a home outside the limits.
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
                f"The home {self._home.tolist()} doesn't fit the {kinematics.dof} joints' limits."
            )
        self.kinematics, self.collisions, self.hand, self.workspace = kinematics, collisions, hand, workspace
        self.ik = InverseKinematics(kinematics, self._home)
        self.dof, self.limits = kinematics.dof, (kinematics.low, kinematics.high)
        self.velocity_limits = kinematics.velocity
        self.forward, self.tool_positions = kinematics.forward, kinematics.positions
        self.inverse, self.line = self.ik.solve, self.ik.line
        self.checker = collisions.checker

    @property
    def home(self) -> FloatArray:
        """(dof,) resting joints, radians."""
        return self._home.copy()

    def clearance(
        self,
        joints: FloatArray,
        gripper: float,
        scene: Scene,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> Clearance:
        """Smallest distance of the arm to itself and the scene, metres; links go by their URDF names."""
        return self.checker(scene, gripper, allowed_contacts, attached).clearance(joints)
