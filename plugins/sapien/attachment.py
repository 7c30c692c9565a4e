"""The option ``attach``: what both fingers touch, in the zone between them, hangs on the hand until they open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2_plugins.sapien.bodies import pose_of

ZONE = (0.02, 0.10, 0.045)
"""Full sides of the zone about the tool centre point, along the hand's x, y (the fingers' way) and z; metres."""


class Clamp:
    """Ties one entity to the hand, rigidly, by a drive; ``holding`` is its name, "" for nothing."""

    def __init__(self, scene: Any, hand: Any) -> None:
        self._scene, self._hand = scene, hand
        self._drive: Any = None
        self._tied: Any = None
        self.holding = ""

    def close(self, entity: Any) -> None:
        """Tie the entity as it lies in the hand now."""
        self.open()
        world_from_hand = np.asarray(self._hand.pose.to_transformation_matrix(), dtype=np.float64)
        world_from_thing = np.asarray(entity.pose.to_transformation_matrix(), dtype=np.float64)
        self._drive = self._scene.create_drive(
            self._hand, pose_of(invert_rigid(world_from_hand) @ world_from_thing), entity, pose_of(np.eye(4))
        )
        for lock in (self._drive.set_limit_x, self._drive.set_limit_y, self._drive.set_limit_z):
            lock(0.0, 0.0)
        self._drive.set_limit_cone(0.0, 0.0)
        self._drive.set_limit_twist(0.0, 0.0)
        self._tied, self.holding = entity, entity.name

    def open(self) -> None:
        """Let go."""
        if self._drive is not None:
            self._tied.remove_component(self._drive)
        self._drive, self._tied, self.holding = None, None, ""


def in_zone(world_from_tcp: FloatArray, points: Sequence[FloatArray]) -> bool:
    """Whether any of the contact points (3,), world, lies in the zone between the fingers."""
    if not len(points):
        return False
    local = transform_points(invert_rigid(world_from_tcp), np.asarray(points))
    return bool((np.abs(local) <= 0.5 * np.asarray(ZONE)).all(axis=1).any())
