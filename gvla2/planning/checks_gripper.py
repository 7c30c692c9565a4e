"""The gripper check: the hand as a state machine, and what is between its fingers when they close."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.arm import Hand
from gvla2.planning.findings import EPS, Finding, Findings
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint

GRASP_REACH = 0.015
"""Largest distance of the grasped object from the space between the fingers, metres: perceived boxes are not exact."""
SHUT = 0.5
"""Openings below it count as closed: a hand that only narrows is preparing."""
TOOL_REACH, NEARER = 0.03, 0.005
"""A closed hand is a tool if it comes this near to an allowed contact, and this much nearer than where it closed."""
SHOVED = 0.02
"""A hand that moves this far sideways through an object, metres, drags it along: its place is then unknown."""
STEP = 0.01
"""Spacing of samples along a move of a closed hand, metres."""


def check_gripper(trajectory: Trajectory, scene: Scene, hand: Hand, start_pose: FloatArray) -> list[Finding]:
    """Open, close on an object, carry it closed, release it, stop carrying; no hand closes on nothing and leaves.

    ``Waypoint.gripper`` is reached after arriving, ``carries`` applies on the way: a waypoint that carries and opens is
    a release. A closed hand may be a tool: it presses, pushes or hooks what it is allowed to touch. If a waypoint is
    malformed (see the schema check), the space between the fingers is not checked.
    """
    finite = all(np.isfinite(w.xyz).all() for w in trajectory)
    poses = trajectory.poses_if_valid(start_pose) if finite else None
    reading = _Reading(trajectory, scene.objects, hand, poses)
    for index in range(len(trajectory)):
        reading.arrive(index)
    reading.emptied(len(trajectory) - 1)
    return reading.found.or_passed("Closes, carries and releases in order.")


class _Reading:
    """The hand while the trajectory is read.

    ``closed`` is the waypoint where it last closed and ``before`` its opening until then; ``objects`` are the objects
    at their present places, ``shoved`` those whose place is unknown; ``grip`` is the carried one's pose in the hand.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        objects: Iterable[SceneObject],
        hand: Hand,
        poses: Sequence[FloatArray] | None,
    ) -> None:
        self.waypoints, self.hand, self.poses = trajectory.waypoints, hand, poses
        self.objects = {obj.id: obj for obj in objects}
        self.found = Findings("gripper", trajectory)
        self.opening, self.before = 1.0, 1.0
        self.carried = ""
        self.closed: int | None = None
        self.grasped = False
        self.grip: FloatArray | None = None
        self.shoved: set[str] = set()

    def arrive(self, i: int) -> None:
        """The move to waypoint ``i``, and its opening or closing."""
        w = self.waypoints[i]
        if not 0.0 <= w.gripper <= 1.0 and np.isfinite(w.gripper):
            self.found.fail(i, "opening_range", f"opening {w.gripper:g} is outside [0, 1].", w.gripper, 1.0)
        self._carry(i, w)
        if i and self.poses is not None:
            self.shoved |= _shoved(self.waypoints[i - 1], w, self.objects)
        if w.gripper < self.opening - EPS:
            self.before = self.opening
            self.closed, self.grasped = i, False
        elif w.gripper > self.opening + EPS:
            following = self.waypoints[i + 1 : i + 2]
            if self.carried and following and following[0].carries == self.carried:
                message = f"the hand opens to {w.gripper:g} while it still carries '{self.carried}'; keep it closed."
                self.found.fail(i, "opens_while_carrying", message, w.gripper, self.opening)
            self.emptied(i)
        self.opening = w.gripper

    def _carry(self, i: int, w: Waypoint) -> None:
        """The held object according to the move to a waypoint."""
        if w.carries and w.carries != self.carried:
            if self.carried:
                message = f"it carries '{w.carries}' while '{self.carried}' was not released; open first."
                self.found.fail(i, "not_released", message)
            elif self.closed is None:
                message = (
                    f"it carries '{w.carries}', on which the hand has not closed; close at the object first."
                )
                self.found.fail(i, "carries_without_grasp", message, self.opening, 1.0)
            elif w.carries in self.objects and self.poses is not None:
                obj, pose = self.objects[w.carries], self.poses[self.closed]
                gap = _gap(obj, pose, self.before, self.hand)
                what = f"the gap between the closing hand and '{w.carries}' (m)"
                self.found.most(self.closed, "grasp_misses", what, gap, GRASP_REACH, "close on the object")
                self.grip = invert_rigid(pose) @ obj.world_from_object
            self.grasped = True
        elif self.carried and not w.carries and self.closed is not None:
            message = (
                f"it no longer carries '{self.carried}', but the hand did not open; open it or carry on."
            )
            self.found.fail(i, "dropped_silently", message)
        self.carried = w.carries

    def emptied(self, i: int) -> None:
        """The hand opens at waypoint ``i``, or the trajectory ends there: did it hold anything since it closed?"""
        if self.poses is not None and self.carried in self.objects and self.grip is not None:
            held = self.objects[self.carried]
            self.objects[held.id] = replace(held, world_from_object=self.poses[i] @ self.grip)
        elif self.poses is not None and self.closed is not None and not self.grasped:
            self._closed_on(self.closed, self.poses[self.closed], self.waypoints[self.closed + 1 : i + 1])
        self.carried, self.closed, self.grip, self.grasped = "", None, None, False

    def _closed_on(self, index: int, pose: FloatArray, after: Sequence[Waypoint]) -> None:
        """A hand that closed at waypoint ``index`` and leaves needs something between its fingers, or is a tool."""
        closed = self.waypoints[index]
        away = any(np.linalg.norm(np.subtract(w.xyz, closed.xyz)) > STEP for w in after)
        if closed.gripper >= SHUT or not away:
            return
        solid = [o for o in self.objects.values() if o.shape != "region"]
        gaps = {o.id: _gap(o, pose, self.before, self.hand) for o in solid}
        nearest = min(gaps, key=lambda name: gaps[name], default="")
        gap = gaps.get(nearest)
        if (gap is None or gap > GRASP_REACH) and not _is_tool(closed, after, self.objects, self.shoved):
            near = "" if gap is None else f" (the nearest, '{nearest}', is {1000 * gap:.0f} mm off)"
            message = (
                f"the hand closes where nothing is between its fingers{near}, and leaves; close on an object, or "
                "name what the closed hand touches in allowed_contacts."
            )
            self.found.fail(index, "closes_on_nothing", message, gap, GRASP_REACH)


def _is_tool(
    closed: Waypoint, after: Sequence[Waypoint], objects: Mapping[str, SceneObject], shoved: Set[str]
) -> bool:
    """Whether the closed hand moves to touch something: a guard waits for it, or it approaches an allowed contact.

    An allowed contact that it shoved before may be anywhere.
    """
    before = closed
    for w in after:
        if w.guard is not None or w.allowed_contacts & shoved:
            return True
        for obj in (objects[name] for name in w.allowed_contacts if name in objects):
            nearest = float(obj.distances(_way(before, w)).min())
            at_first = float(obj.distances(closed.xyz))
            if nearest < TOOL_REACH and nearest < at_first - NEARER:
                return True
        before = w
    return False


def _shoved(before: Waypoint, w: Waypoint, objects: Mapping[str, SceneObject]) -> set[str]:
    """The objects that a straight move with an empty hand drags along."""
    if w.motion != "linear" or w.carries:
        return set()
    way = _way(before, w)
    sideways = float(np.linalg.norm(way[-1, :2] - way[0, :2]))
    touched = (objects[name] for name in w.allowed_contacts if name in objects)
    return {o.id for o in touched if sideways * float((o.distances(way) < STEP).mean()) > SHOVED}


def _way(before: Waypoint, w: Waypoint) -> FloatArray:
    """(N, 3) points of the tool along the move to a waypoint."""
    a, b = np.asarray(before.xyz), np.asarray(w.xyz)
    return np.linspace(a, b, max(2, int(np.ceil(np.linalg.norm(b - a) / STEP)) + 1))


def _gap(obj: SceneObject, world_from_tcp: FloatArray, opening: float, hand: Hand) -> float:
    """Distance of an object's box from the space between the fingers, ``opening`` in [0, 1], metres; 0 within it."""
    half = 0.5 * float(np.clip(opening, 0.0, 1.0)) * hand.max_width
    tip = hand.tip_beyond_tcp
    x = np.linspace(-0.5, 0.5, 3) * hand.finger_breadth
    y = np.linspace(-half, half, 9)
    z = np.linspace(tip - hand.finger_length, tip, 5)
    between = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(obj.distances(transform_points(world_from_tcp, between)).min())
