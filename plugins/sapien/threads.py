"""Threads and catches: bodies that are screwed together, and joints that hold until another has moved."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid
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
"""A screwed body that leans by more is set upright: the engine holds it in its place, but fingers that slip off it tip
it on its edge, where it would stay.
"""
HALF = np.pi - SLACK
"""Radians either way that the engine can bound."""


class Screwed:
    """One thread, tight until it is loose. ``angle`` is the turn now, radians; ``peak`` the largest either way."""

    def __init__(self, scene: Any, thread: Thread, layout: Layout, entities: dict[str, Any]) -> None:
        self._scene, self._thread = scene, thread
        self._parent, self._child = entities[thread.parent], entities[thread.child]
        low, high = thread.limits
        self._long = low < -np.pi or high > np.pi
        frame = axis_frame(thread.axis, thread.origin)
        parent, child = layout[thread.parent].world_from_body, layout[thread.child].world_from_body
        self._axis = parent[:3, :3].T @ frame[:3, 0]
        self._start = parent[:3, :3].T @ child[:3, :3]
        self._mover = next(c for c in self._child.components if hasattr(c, "set_angular_velocity"))
        self._frames = tuple(pose_of(invert_rigid(body) @ frame) for body in (parent, child))
        self._drive: Any = None
        self.loose = False
        self.angle = self.peak = 0.0
        self._tie()

    def _tie(self) -> None:
        """Tie the two at the present turn: the engine's joints know no turns beyond a half either way."""
        if self._drive is not None:
            self._child.remove_component(self._drive)
        # By quaternions, whose sign the engine respects: a matrix would not distinguish a whole turn from none.
        half = 0.5 * self.angle
        back = import_sapien().Pose([0.0, 0.0, 0.0], [np.cos(half), -np.sin(half), 0.0, 0.0])
        parent, child = self._frames
        self._drive = self._scene.create_drive(self._parent, parent, self._child, child * back)
        for lock in (self._drive.set_limit_x, self._drive.set_limit_y, self._drive.set_limit_z):
            lock(0.0, 0.0)
        self._drive.set_limit_cone(0.0, 0.0)
        low, high = (limit - self.angle for limit in self._thread.limits)
        if self._long:
            low, high = max(low, SLACK - HALF), min(high, HALF - SLACK)
        self._drive.set_limit_twist(low - SLACK, high + SLACK)
        self._drive.set_drive_property_twist(0.0, self._thread.damping)
        self._tied_at = self.angle

    def watch(self) -> None:
        """Read the turn, and release the child when it is far enough."""
        if self.loose:
            return
        turned = Rotation.from_matrix(_turn(self._parent).T @ _turn(self._child) @ self._start.T)
        # About the axis, whatever the child tilts, and over whole turns: never more than half of one at a time.
        x, y, z, w = turned.as_quat()
        step = 2.0 * float(np.arctan2(self._axis @ (x, y, z), w)) - self.angle
        step = (step + np.pi) % (2.0 * np.pi) - np.pi
        if self._long and abs(step) > BINDS:
            self._mover.set_angular_velocity([0.0, 0.0, 0.0])
        self.angle += step
        self.peak = max(self.peak, abs(self.angle))
        if turned.apply(self._axis) @ self._axis < np.cos(LEANS):
            self._set_upright()
        if self._long and abs(self.angle - self._tied_at) > FAR:
            self._tie()
        if self.peak >= self._thread.release:
            self._child.remove_component(self._drive)
            self.loose = True

    def _set_upright(self) -> None:
        """Remove the lean of the child."""
        straight = Rotation.from_rotvec(self.angle * self._axis).as_matrix()
        self._child.set_pose(pose_of(rigid(_turn(self._parent) @ straight @ self._start, self._child.pose.p)))
        self._mover.set_angular_velocity([0.0, 0.0, 0.0])


def _turn(entity: Any) -> FloatArray:
    return np.asarray(entity.pose.to_transformation_matrix(), dtype=np.float64)[:3, :3]


class Caught:
    """One catch: it locks or unlocks while its joint is at rest, and stays free once that has moved."""

    def __init__(self, catch: Catch, held: Joint, joints: dict[str, tuple[Any, int]]) -> None:
        self._catch, self._free = catch, held.limits
        low, high = held.limits
        self._shut = (max(low, held.rest - catch.play), min(high, held.rest + catch.play))
        self._articulation, self._index = joints[catch.joint]
        self._joint = self._articulation.active_joints[self._index]
        self._key, self._place = joints[catch.key]
        self._holds, self._gone = True, False
        self._joint.set_limits([list(self._shut)])

    def watch(self) -> None:
        """Lock or unlock by the key's present position."""
        if self._gone:
            return
        (low, high), play = self._shut, self._catch.play
        at = float(self._articulation.qpos[self._index])
        self._gone = not self._holds and not low - play <= at <= high + play
        key = float(self._key.qpos[self._place])
        holds = not self._gone and not self._catch.travel <= key <= self._catch.until
        if holds != self._holds:
            self._holds = holds
            self._joint.set_limits([list(self._shut if holds else self._free)])
