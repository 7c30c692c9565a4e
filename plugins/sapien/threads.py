"""Screwed parts: a drive with limits ties them, and is taken away once they are turned far enough."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid
from gvla2.robot.task import Layout, Thread
from gvla2_plugins.sapien.bodies import axis_frame, pose_of

SLACK = 0.02
"""Radians by which a thread's stop gives, so that it does not ring."""


class Screwed:
    """One thread, tight until it is loose. ``angle`` is the turn now, radians; ``peak`` the largest either way."""

    def __init__(self, scene: Any, thread: Thread, layout: Layout, entities: dict[str, Any]) -> None:
        self._thread = thread
        self._parent, self._child = entities[thread.parent], entities[thread.child]
        frame = axis_frame(thread.axis, thread.origin)
        parent, child = layout[thread.parent], layout[thread.child]
        self._axis = parent.world_from_body[:3, :3].T @ frame[:3, 0]
        self._start = parent.world_from_body[:3, :3].T @ child.world_from_body[:3, :3]
        self._drive = scene.create_drive(
            self._parent,
            pose_of(invert_rigid(parent.world_from_body) @ frame),
            self._child,
            pose_of(invert_rigid(child.world_from_body) @ frame),
        )
        for lock in (self._drive.set_limit_x, self._drive.set_limit_y, self._drive.set_limit_z):
            lock(0.0, 0.0)
        self._drive.set_limit_cone(0.0, 0.0)
        low, high = thread.limits
        self._drive.set_limit_twist(low - SLACK, high + SLACK)
        self._drive.set_drive_property_twist(0.0, thread.damping)
        self.loose = False
        self.angle = self.peak = 0.0

    def watch(self) -> None:
        """Read the turn, and let go when it is far enough."""
        if not self.loose:
            relative = _turn(self._parent).T @ _turn(self._child)
            turned = float(Rotation.from_matrix(relative @ self._start.T).as_rotvec() @ self._axis)
            # A rotation vector says nothing of whole turns: a step is never more than half of one.
            self.angle += (turned - self.angle + np.pi) % (2.0 * np.pi) - np.pi
            self.peak = max(self.peak, abs(self.angle))
            if self.peak >= self._thread.release:
                self._child.remove_component(self._drive)
                self.loose = True


def _turn(entity: Any) -> FloatArray:
    return np.asarray(entity.pose.to_transformation_matrix(), dtype=np.float64)[:3, :3]
