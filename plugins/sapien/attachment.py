"""Attachments to the hand: with ``attach`` an object that both fingers touch, until they open; or by a suction cup."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.robot.grippers import BELLOWS, CUP_LENGTH
from gvla2_plugins.sapien.bodies import pose_of

ZONE = (0.02, 0.10, 0.045)
"""Full sides of the zone about the tool centre point, along the hand's x, y (the fingers' way) and z; metres."""


DRAWN = BELLOWS + 0.006
"""A cup's bellows close on objects this near to its solid end, metres."""


class Clamp:
    """Ties one entity to the hand, rigidly, by a drive; ``holding`` is its name, "" for nothing."""

    def __init__(self, scene: Any, hand: Any) -> None:
        self._scene, self.hand = scene, hand
        self._drive: Any = None
        self._tied: Any = None
        self.holding = ""

    def close(self, entity: Any) -> None:
        """Tie the entity as it lies in the hand now."""
        self.open()
        world_from_hand = np.asarray(self.hand.pose.to_transformation_matrix(), dtype=np.float64)
        world_from_object = np.asarray(entity.pose.to_transformation_matrix(), dtype=np.float64)
        self._drive = self._scene.create_drive(
            self.hand, pose_of(invert_rigid(world_from_hand) @ world_from_object), entity, pose_of(np.eye(4))
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


class Suction:
    """A cup at the end of the hand's z: while it sucks, the first movable object at its lip is attached."""

    def __init__(self, system: Any, clamp: Clamp, width: float) -> None:
        self._system, self._clamp, self._width, self._draws = system, clamp, width, False

    @property
    def width(self) -> float:
        """The equivalent gripper width: ``width`` without suction, half of it with something attached, else 0."""
        return self._width * (0.5 * bool(self._clamp.holding) if self._draws else 1.0)

    def draw(self, on: bool) -> None:
        """Start or stop; an attached object falls."""
        self._draws = on
        if not on:
            self._clamp.open()

    def watch(self) -> None:
        """After each step: the bellows close on objects at the lip."""
        if not self._draws or self._clamp.holding:
            return
        world_from_hand = np.asarray(self._clamp.hand.pose.to_transformation_matrix(), dtype=np.float64)
        start = world_from_hand @ [0.0, 0.0, CUP_LENGTH - BELLOWS + 5e-4, 1.0]
        hit = self._system.raycast(
            start[:3].astype(np.float32), world_from_hand[:3, 2].astype(np.float32), DRAWN
        )
        entity = None if hit is None else hit.component.entity
        if entity is not None and any(getattr(c, "mass", 0.0) > 0 for c in entity.components):
            self._clamp.close(entity)


def in_zone(world_from_tcp: FloatArray, points: Sequence[FloatArray]) -> bool:
    """Whether any of the contact points (3,), world, lies in the zone between the fingers."""
    if not len(points):
        return False
    local = transform_points(invert_rigid(world_from_tcp), np.asarray(points))
    return bool((np.abs(local) <= 0.5 * np.asarray(ZONE)).all(axis=1).any())
