"""Waypoints relative to objects: from an executed trajectory, so that its success can be repeated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint

STILL = 0.002
"""Waypoints nearer than this are merged, metres."""
ASIDE = 0.03
"""Distance from an object's middle beyond which a place is given by the direction to another object, metres."""
ALONG = 0.95
"""Least cosine between such an offset and the direction to the other object."""
OVER = 0.06
"""An object carried this near to the goal's middle, horizontal metres, is given relative to the goal."""


def relative_steps(trajectory: Trajectory, scene: Scene, roles: Mapping[str, str]) -> list[list[Any]]:
    """``[id, dx, dy, up, g]`` or ``[id, other, along, up, g]`` per waypoint, millimetres; see ``Program``.

    Waypoints at one place are merged, and those after the release are left out: they did not contribute to the success.
    Empty if the plan names no theme of the scene.
    """
    known = {o.id: o for o in scene.objects}
    theme, goal = known.get(roles.get("theme", "")), known.get(roles.get("goal", ""))
    if theme is None:
        return []
    steps: list[list[Any]] = []
    for waypoint, opened in _distinct(trajectory):
        at = np.asarray(waypoint.xyz)
        near_goal = goal is not None and float(np.linalg.norm((at - goal.centre)[:2])) < OVER
        taken = bool(waypoint.carries) or any(s[-1] == 0 for s in steps)
        first = goal if goal is not None and near_goal and taken else theme
        other = theme if first is goal else goal
        steps.append(_step(at, opened, first, other))
        if len(steps) > 1 and opened and not steps[-2][-1]:
            break  # release
    return steps


def _distinct(trajectory: Trajectory) -> list[tuple[Waypoint, bool]]:
    """The distinct waypoints, each with whether the hand is open there.

    Before a narrow grasp the hand opens only a little: open means wider than the middle of its openings. A hand that
    never changes pushes or presses, and counts as closed.
    """
    openings = [waypoint.gripper for waypoint in trajectory]
    middle = (min(openings) + max(openings)) / 2
    kept: list[tuple[Waypoint, bool]] = []
    for waypoint in trajectory:
        opened = waypoint.gripper > middle
        still = kept and float(np.linalg.norm(np.subtract(waypoint.xyz, kept[-1][0].xyz))) < STILL
        if not still or kept[-1][1] != opened:
            kept.append((waypoint, opened))
    return kept


def _step(at: FloatArray, opened: bool, first: SceneObject, other: SceneObject | None) -> list[Any]:
    up, g = round(1e3 * float(at[2] - first.top)), int(opened)
    offset = (at - first.centre)[:2]
    if other is not None and float(np.linalg.norm(offset)) > ASIDE:
        way = (other.centre - first.centre)[:2]
        length = float(np.linalg.norm(way))
        along = float(offset @ way) / max(length, 1e-9)
        if abs(along) > ALONG * float(np.linalg.norm(offset)):
            return [first.id, other.id, round(1e3 * along), up, g]
    dx, dy = (round(1e3 * float(v)) for v in offset)
    return [first.id, dx, dy, up, g]
