"""The gripper check: the hand as a state machine, and what is between its fingers when they close."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.arm import Hand
from gvla2.planning.checks_words import EPS, passed, tool_poses, where
from gvla2.planning.findings import Finding
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


@dataclass
class _Hand:
    """The hand while the trajectory is read: ``closed`` is where it last closed, ``before`` its opening until then.

    ``things`` are the objects at their present places, ``shoved`` those whose place is unknown; ``grip`` is the carried
    one's pose in the hand.
    """

    things: dict[str, SceneObject]
    opening: float = 1.0
    carried: str = ""
    closed: int | None = None
    before: float = 1.0
    grasped: bool = False
    grip: FloatArray | None = None
    shoved: set[str] = field(default_factory=set)
    found: list[Finding] = field(default_factory=list)

    def fail(
        self, index: int, kind: str, message: str, value: float | None = None, limit: float | None = None
    ) -> None:
        self.found.append(Finding("gripper", False, index, kind, message, value, limit))


def check_gripper(trajectory: Trajectory, scene: Scene, hand: Hand, start_pose: FloatArray) -> list[Finding]:
    """Open, close on an object, carry it closed, release it, stop carrying; no hand closes on nothing and leaves.

    ``Waypoint.gripper`` is reached after arriving, ``carries`` applies on the way: a waypoint that carries and opens is
    a release. A closed hand may be a tool: it presses, pushes or hooks what it is allowed to touch. If a waypoint is
    malformed (see the schema check), the space between the fingers is not checked.
    """
    state = _Hand({o.id: o for o in scene.objects})
    finite = all(np.isfinite(w.xyz).all() for w in trajectory)
    poses = tool_poses(trajectory, start_pose) if finite else None
    for i, w in enumerate(trajectory):
        _carrying(state, i, w, hand, poses)
        if i and poses is not None:
            state.shoved |= _shoved(trajectory.waypoints[i - 1], w, state.things)
        if w.gripper < state.opening - EPS:
            state.before = state.opening
            state.closed, state.grasped = i, False
        elif w.gripper > state.opening + EPS:
            following = trajectory.waypoints[i + 1 : i + 2]
            if state.carried and following and following[0].carries == state.carried:
                state.fail(
                    i,
                    "opens_while_carrying",
                    f"{where(i, w)} opens the hand to {w.gripper:g} while it still carries '{state.carried}'; "
                    "keep closed.",
                    w.gripper,
                    state.opening,
                )
            _emptied(state, i, trajectory.waypoints, hand, poses)
        state.opening = w.gripper
    _emptied(state, len(trajectory) - 1, trajectory.waypoints, hand, poses)
    return state.found or [passed("gripper", "Closes, carries and releases in order.")]


def _carrying(state: _Hand, i: int, w: Waypoint, hand: Hand, poses: Sequence[FloatArray] | None) -> None:
    """The held object according to the move to a waypoint."""
    name = where(i, w)
    if not 0.0 <= w.gripper <= 1.0 and np.isfinite(w.gripper):
        state.fail(i, "opening_range", f"{name}: opening {w.gripper:g} is outside [0, 1].", w.gripper, 1.0)
    if w.carries and w.carries != state.carried:
        if state.carried:
            message = f"{name} carries '{w.carries}' while '{state.carried}' was not released; open first."
            state.fail(i, "not_released", message)
        elif state.closed is None:
            message = (
                f"{name} carries '{w.carries}', but the hand has not closed on it; close at the object first."
            )
            state.fail(i, "carries_without_grasp", message, state.opening, 1.0)
        elif w.carries in state.things and poses is not None:
            thing, pose = state.things[w.carries], poses[state.closed]
            gap = _gap(thing, pose, state.before, hand)
            if gap > GRASP_REACH:
                state.fail(
                    state.closed,
                    "grasp_misses",
                    f"The hand closes {gap * 1000:.0f} mm beside '{w.carries}'; close within "
                    f"{GRASP_REACH * 1000:.0f} mm of it.",
                    gap,
                    GRASP_REACH,
                )
            state.grip = invert_rigid(pose) @ thing.world_from_object
        state.grasped = True
    elif state.carried and not w.carries and state.closed is not None:
        message = (
            f"{name} no longer carries '{state.carried}', but the hand did not open; open it or carry on."
        )
        state.fail(i, "dropped_silently", message)
    state.carried = w.carries


def _emptied(
    state: _Hand, i: int, waypoints: Sequence[Waypoint], hand: Hand, poses: Sequence[FloatArray] | None
) -> None:
    """The hand opens at waypoint ``i``, or the trajectory ends there: did it hold anything since it closed?"""
    closed = state.closed
    if poses is not None and state.carried in state.things and state.grip is not None:
        held = state.things[state.carried]
        state.things[held.id] = replace(held, world_from_object=poses[i] @ state.grip)
    elif closed is not None and poses is not None and not state.grasped and waypoints[closed].gripper < SHUT:
        solid = [o for o in state.things.values() if o.shape != "region"]
        gaps = [_gap(o, poses[closed], state.before, hand) for o in solid]
        after = waypoints[closed + 1 : i + 1]
        away = any(np.linalg.norm(np.subtract(w.xyz, waypoints[closed].xyz)) > STEP for w in after)
        if away and min(gaps, default=np.inf) > GRASP_REACH and not _is_tool(waypoints[closed], after, state):
            nearest = solid[int(np.argmin(gaps))].id if solid else ""
            near = f" (the nearest, '{nearest}', is {1000 * min(gaps):.0f} mm off)" if nearest else ""
            state.fail(
                closed,
                "closes_on_nothing",
                f"{where(closed, waypoints[closed])}: the hand closes where nothing is between its fingers{near}, and "
                "leaves; close on an object, or say by allowed_contacts what the closed hand is to touch.",
                min(gaps, default=None),
                GRASP_REACH,
            )
    state.carried, state.closed, state.grip, state.grasped = "", None, None, False


def _is_tool(closed: Waypoint, after: Sequence[Waypoint], state: _Hand) -> bool:
    """Whether the closed hand moves to touch something: a guard waits for it, or it approaches an allowed contact.

    An allowed contact that it shoved before may be anywhere.
    """
    before = closed
    for w in after:
        if w.guard is not None or w.allowed_contacts & state.shoved:
            return True
        for thing in (state.things[name] for name in w.allowed_contacts if name in state.things):
            nearest = float(_outside(thing, _way(before, w)).min())
            at_first = float(_outside(thing, np.atleast_2d(closed.xyz)).min())
            if nearest < TOOL_REACH and nearest < at_first - NEARER:
                return True
        before = w
    return False


def _shoved(before: Waypoint, w: Waypoint, things: dict[str, SceneObject]) -> set[str]:
    """The objects that a straight move with an empty hand drags along."""
    if w.motion != "linear" or w.carries:
        return set()
    way = _way(before, w)
    sideways = float(np.linalg.norm(way[-1, :2] - way[0, :2]))
    touched = (things[name] for name in w.allowed_contacts if name in things)
    return {o.id for o in touched if sideways * float((_outside(o, way) < STEP).mean()) > SHOVED}


def _way(before: Waypoint, w: Waypoint) -> FloatArray:
    """(N, 3) points of the tool along the move to a waypoint."""
    a, b = np.asarray(before.xyz), np.asarray(w.xyz)
    return np.linspace(a, b, max(2, int(np.ceil(np.linalg.norm(b - a) / STEP)) + 1))


def _gap(thing: SceneObject, world_from_tcp: FloatArray, opening: float, hand: Hand) -> float:
    """Distance of a thing's box from the space between the fingers, ``opening`` in [0, 1], metres; 0 within it."""
    half = 0.5 * float(np.clip(opening, 0.0, 1.0)) * hand.max_width
    tip = hand.tip_beyond_tcp
    x = np.linspace(-0.5, 0.5, 3) * hand.finger_breadth
    y = np.linspace(-half, half, 9)
    z = np.linspace(tip - hand.finger_length, tip, 5)
    between = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(_outside(thing, transform_points(world_from_tcp, between)).min())


def _outside(thing: SceneObject, points: FloatArray) -> FloatArray:
    """(N,) how far points (N, 3) lie outside a thing's box, metres; 0 inside."""
    local = np.abs(transform_points(invert_rigid(thing.world_from_object), points)) - 0.5 * thing.extents
    return np.asarray(np.linalg.norm(np.maximum(local, 0.0), axis=1))
