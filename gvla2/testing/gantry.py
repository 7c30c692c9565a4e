"""A gantry: the simplest arm that fills the Arm contract, for checks and for tests of planners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray, box_corners, invert_rigid, rigid, transform_points
from gvla2.planning.arm import Attachment, Clearance, Hand, IKSolution
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import grasp_rotation

DOWN = np.array([0.0, 0.0, -1.0])
TILT = 0.05
"""How far from straight down, as 1 - cos, a pose may point and still be reached."""

SPARE_TRAVEL = 0.1
"""Metres that the axes go beyond the workspace, so that its border is not a joint limit."""


class Gantry:
    """Joints (x, y, z, yaw) in metres and radians: the hand always points down.

    ``workspace`` bounds the tool centre point. The hand is a box about the fingers; clearance is exact for
    points against oriented boxes, taken over the corners and edges of the hand.
    """

    def __init__(self, workspace: Box, hand: Hand | None = None) -> None:
        self._workspace = workspace
        self._hand = hand or Hand(
            max_width=0.08,
            finger_length=0.05,
            finger_thickness=0.015,
            finger_breadth=0.02,
            tip_beyond_tcp=0.01,
            palm_breadth=0.2,
            palm_depth=0.06,
        )

    @property
    def hand(self) -> Hand:
        """The gripper's geometry, metres."""
        return self._hand

    @property
    def home(self) -> FloatArray:
        """(4,) high above the middle of the workspace."""
        centre = 0.5 * (self._workspace.low + self._workspace.high)
        return np.array([centre[0], centre[1], self._workspace.high[2] - 0.1, 0.0])

    @property
    def workspace(self) -> Box:
        """Where the tool centre point may go."""
        return self._workspace

    def forward(self, joints: FloatArray) -> FloatArray:
        """world_from_tcp (4, 4) at joints (4,)."""
        x, y, z, yaw = (float(v) for v in joints)
        closing = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        return rigid(grasp_rotation(DOWN, closing), (x, y, z))

    def inverse(self, world_from_tcp: FloatArray, near: FloatArray | None = None) -> IKSolution | None:
        """Joints for a pose that points down inside the workspace, else None."""
        approach, closing, position = world_from_tcp[:3, 2], world_from_tcp[:3, 1], world_from_tcp[:3, 3]
        if 1.0 - approach @ DOWN > TILT or not self._workspace.contains(position):
            return None
        turn = float(np.arctan2(-closing[0], closing[1]))
        if near is not None:  # the hand is symmetric: take the nearer half turn
            turn += np.pi * round((float(near[3]) - turn) / np.pi)
        joints = np.array([*position, turn])
        inside = min((position - self._workspace.low).min(), (self._workspace.high - position).min())
        return IKSolution(joints, float(inside) + SPARE_TRAVEL, 1.0)

    def clearance(
        self,
        joints: FloatArray,
        gripper: float,
        scene: Scene,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> Clearance:
        """Smallest distance of the hand (and of what it holds) to the scene's boxes and the table."""
        tcp = self.forward(joints)
        points = transform_points(tcp, self._hand_points(gripper))
        carried = attached.object.id if attached else ""
        if attached is not None:
            corners = box_corners(attached.object.extents)
            points = np.vstack([points, transform_points(tcp @ attached.tcp_from_object, corners)])
        found = [Clearance(float("inf"))]
        for thing in scene.obstacles(allowed_contacts | {carried}):
            found.append(Clearance(_distance(points, thing), "hand", thing.id))
        if "table" not in allowed_contacts:
            found.append(Clearance(float(points[:, 2].min() - scene.table_height), "hand", "table"))
        return min(found, key=lambda c: c.distance)

    def line(
        self, start: FloatArray, world_from_tcp: FloatArray, step: float = 0.01
    ) -> Sequence[FloatArray] | None:
        """Joints (4,) along a straight line; a gantry's joints move straight as well."""
        end = self.inverse(world_from_tcp, start)
        if end is None:
            return None
        count = max(2, int(np.ceil(np.linalg.norm(end.joints[:3] - start[:3]) / step)) + 1)
        return list(np.linspace(start, end.joints, count))

    def _hand_points(self, gripper: float) -> FloatArray:
        """(N, 3) points on both fingers and the palm, tool frame."""
        hand = self._hand
        inner = 0.5 * hand.max_width * gripper
        points = []
        for side in (-1.0, 1.0):
            for y in (inner, inner + hand.finger_thickness):
                for x in (-0.5 * hand.finger_breadth, 0.5 * hand.finger_breadth):
                    for z in np.linspace(hand.tip_beyond_tcp - hand.finger_length, hand.tip_beyond_tcp, 4):
                        points.append((x, side * y, z))
            for x in (-0.5 * hand.palm_depth, 0.5 * hand.palm_depth):
                points.append((x, 0.5 * side * hand.palm_breadth, hand.tip_beyond_tcp - hand.finger_length))
        return np.array(points)


def _distance(points: FloatArray, thing: SceneObject) -> float:
    """Signed distance from points (N, 3) to the thing's oriented box, the smallest of all, metres."""
    local = np.abs(transform_points(invert_rigid(thing.world_from_object), points)) - 0.5 * thing.extents
    outside = np.linalg.norm(np.maximum(local, 0.0), axis=1)
    return float((outside + np.minimum(local.max(axis=1), 0.0)).min())
