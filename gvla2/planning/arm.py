"""What planning needs to know about an arm: reach, limits, clearance. A robot backend provides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Box, Scene, SceneObject


@dataclass(frozen=True)
class Hand:
    """A parallel gripper's geometry, metres, about its tool centre point (TCP, between the fingertips).

    ``max_width`` between the opened fingers; ``finger_length`` from the palm to the fingertips;
    ``finger_thickness`` of one finger along the closing direction (also how far it reaches out beside a grasped
    object); ``finger_breadth`` across it; ``tip_beyond_tcp`` from the TCP to the fingertips' end;
    ``palm_breadth`` (along y) and ``palm_depth`` (along x) of the hand's body.
    """

    max_width: float
    finger_length: float
    finger_thickness: float
    finger_breadth: float
    tip_beyond_tcp: float
    palm_breadth: float
    palm_depth: float


@dataclass(frozen=True)
class IKSolution:
    """Joints (dof,) in radians for a pose, with measures of their quality.

    ``limit_margin`` is the smallest distance to a joint limit, radians; ``manipulability`` is sqrt(det(J J^T)) as a
    share of the arm's best (0 at a singularity), so that small and large arms are comparable.
    """

    joints: FloatArray
    limit_margin: float
    manipulability: float


@dataclass(frozen=True)
class Clearance:
    """Smallest distance of the arm to itself or the scene, metres (negative: penetration), and between what."""

    distance: float
    robot_part: str = ""
    other: str = ""


@dataclass(frozen=True)
class Attachment:
    """A held object: it moves with the tool at ``tcp_from_object`` (4, 4)."""

    object: SceneObject
    tcp_from_object: FloatArray


class Arm(Protocol):
    """An arm's kinematics and collision model, free of any simulator."""

    @property
    def hand(self) -> Hand:
        """The gripper's geometry."""
        ...

    @property
    def home(self) -> FloatArray:
        """(dof,) resting joints, radians."""
        ...

    @property
    def workspace(self) -> Box:
        """Where the tool centre point may go, world frame."""
        ...

    def forward(self, joints: FloatArray) -> FloatArray:
        """world_from_tcp (4, 4) at joints (dof,), radians."""
        ...

    def inverse(self, world_from_tcp: FloatArray, near: FloatArray | None = None) -> IKSolution | None:
        """Joints for a tool pose (4, 4), the solution nearest to ``near`` (dof,); None when out of reach."""
        ...

    def clearance(
        self,
        joints: FloatArray,
        gripper: float,
        scene: Scene,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> Clearance:
        """Clearance at joints (dof,) with the hand opened by ``gripper`` in [0, 1], against the perceived scene.

        ``allowed_contacts`` (object ids, "table") are ignored for the hand and what it carries; an ``attached`` object
        moves with the hand and is not an obstacle to it.
        """
        ...

    def line(
        self, start: FloatArray, world_from_tcp: FloatArray, step: float = 0.01
    ) -> Sequence[FloatArray] | None:
        """Joints (dof,) every ``step`` metres of a straight tool move from joints ``start``; None if impossible."""
        ...
