"""Threads and catches: parts that are screwed together, and joints that hold until another has moved."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid
from gvla2.robot.task import Catch, Joint, Layout, Thread
from gvla2_plugins.sapien.bodies import axis_frame, import_sapien, pose_of

SLACK = 0.02
"""Compliance of a thread's stop, radians, so that it does not oscillate."""
FAR = 0.5 * np.pi
"""Radians of turn after which a thread of more than half a turn is re-tied."""
BINDS = 0.01
"""Radians per physics step above which a long thread binds: a hand turns it more slowly, and fingers that slip off its
cap would spin it loose.
"""
LEANS = np.deg2rad(1.0)
"""A screwed part that leans by more is set upright: the engine holds it in its place, but fingers that slip off it tip
it on its edge, where it would stay.
"""
HALF = np.pi - SLACK
"""Radians either way that the engine can bound."""


class Screwed:
    """One thread, tight until it is loose. ``angle`` is the turn now, radians; ``peak`` the largest either way."""

    def __init__(self, scene: Any, thread: Thread, layout: Layout, entities: dict[str, Any]) -> None:
        self._thread = thread
        self._parent, self._child = entities[thread.parent], entities[thread.child]
        frame = axis_frame(thread.axis, thread.origin)
        parent, child = layout[thread.parent], layout[thread.child]
        self._axis = parent.world_from_body[:3, :3].T @ frame[:3, 0]
        self._start = parent.world_from_body[:3, :3].T @ child.world_from_body[:3, :3]
        self._scene = scene
        self._mover = next(c for c in self._child.components if hasattr(c, "set_angular_velocity"))
        self._frames = tuple(pose_of(invert_rigid(body.world_from_body) @ frame) for body in (parent, child))
        self._drive: Any = None
        self._tied_at = 0.0
        self._tie(0.0)
        self.loose = False
        self.angle = self.peak = 0.0

    def _tie(self, angle: float) -> None:
        """Re-tie the parts at a turn, radians: the engine's joints know no turns beyond a half either way."""
        if self._drive is not None:
            self._child.remove_component(self._drive)
        # By quaternions, whose sign the engine respects: a matrix would not distinguish a whole turn from none.
        half = 0.5 * angle
        back = import_sapien().Pose([0.0, 0.0, 0.0], [np.cos(half), -np.sin(half), 0.0, 0.0])
        parent, child = self._frames
        self._drive = self._scene.create_drive(self._parent, parent, self._child, child * back)
        for lock in (self._drive.set_limit_x, self._drive.set_limit_y, self._drive.set_limit_z):
            lock(0.0, 0.0)
        self._drive.set_limit_cone(0.0, 0.0)
        low, high = (limit - angle for limit in self._thread.limits)
        if not self._within():
            low, high = max(low, SLACK - HALF), min(high, HALF - SLACK)
        self._drive.set_limit_twist(low - SLACK, high + SLACK)
        self._drive.set_drive_property_twist(0.0, self._thread.damping)
        self._tied_at = angle

    def _within(self) -> bool:
        """Whether the thread is so short that the engine can bound all of it from where it began."""
        low, high = self._thread.limits
        return bool(self._tied_at == 0.0 and -np.pi <= low and high <= np.pi)

    def watch(self) -> None:
        """Read the turn, and release the parts when it is far enough."""
        if not self.loose:
            relative = _turn(self._parent).T @ _turn(self._child)
            turned = Rotation.from_matrix(relative @ self._start.T)
            self.angle = float(turned.as_rotvec() @ self._axis) if self._within() else self._further(turned)
            self.peak = max(self.peak, abs(self.angle))
            self._upright(turned)
            if abs(self.angle - self._tied_at) > FAR and not self._within():
                self._tie(self.angle)
            if self.peak >= self._thread.release:
                self._child.remove_component(self._drive)
                self.loose = True

    def _upright(self, turned: Rotation) -> None:
        """Remove the lean of a part, given its turn from the start."""
        cosine = float(turned.apply(self._axis) @ self._axis)
        if cosine >= np.cos(LEANS):
            return
        world_from_parent = _turn(self._parent)
        straight = Rotation.from_rotvec(self.angle * self._axis).as_matrix()
        pose = np.eye(4)
        pose[:3, :3] = world_from_parent @ straight @ self._start
        pose[:3, 3] = self._child.pose.p
        self._child.set_pose(pose_of(pose))
        self._mover.set_angular_velocity([0.0, 0.0, 0.0])

    def _further(self, turned: Rotation) -> float:
        """The turn of a long thread, radians, over whole turns: about the axis, whatever the part tilts."""
        x, y, z, w = turned.as_quat()
        now = 2.0 * float(np.arctan2(self._axis @ (x, y, z), w))
        step = (now - self.angle + np.pi) % (2.0 * np.pi) - np.pi  # never more than half of one at a time
        if abs(step) > BINDS:
            self._mover.set_angular_velocity([0.0, 0.0, 0.0])
        return self.angle + step


def _turn(entity: Any) -> FloatArray:
    return np.asarray(entity.pose.to_transformation_matrix(), dtype=np.float64)[:3, :3]


class Caught:
    """One catch: it locks or unlocks while its joint is at rest, and stays free once that has moved."""

    def __init__(self, catch: Catch, held: Joint, joints: dict[str, tuple[Any, int]]) -> None:
        self._catch = catch
        self._free = held.limits
        self._shut = (
            max(held.limits[0], held.rest - catch.play),
            min(held.limits[1], held.rest + catch.play),
        )
        self._articulation, self._index = joints[catch.joint]
        self._joint = self._articulation.active_joints[self._index]
        self._key, self._place = joints[catch.key]
        self._holds = True
        self._gone = False
        self._joint.set_limits([list(self._shut)])

    def watch(self) -> None:
        """Lock or unlock by the key's present position."""
        if self._gone:
            return
        low, high = self._shut
        away = (
            not low - self._catch.play
            <= float(self._articulation.qpos[self._index])
            <= high + self._catch.play
        )
        self._gone = away and not self._holds
        at = float(self._key.qpos[self._place])
        holds = not self._gone and not self._catch.travel <= at <= self._catch.until
        if holds != self._holds:
            self._holds = holds
            self._joint.set_limits([list(self._shut if holds else self._free)])
