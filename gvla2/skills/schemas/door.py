"""Doors: turn the lever and pull, or pull the fixed handle, along the hinge's arc; push one shut at its free edge."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Trajectory
from gvla2.skills.mechanisms import UP, Door
from gvla2.skills.proposals import Grasp, Path
from gvla2.skills.schemas.pick_place import let_go, take

STEP = 0.5
"""Greatest angle between waypoints on an arc, radians: chords of a handle's or a door's are within 2 cm of it."""
GIVE = 0.03
"""Tolerance along the arcs, metres: the hinge guides the door, and the arm yields."""
PLAY = 0.006
"""The open hand must be wider than the handle by this much, metres."""
ALONG = (0.75, 0.6, 0.9)
"""Places on a lever to grasp, as shares of its length from where it turns."""
LEANS = (0.0, 0.3, -0.3, 0.6)
"""Turns of the hand about the upright, from square to the door, radians."""
NODS = (0.0, 0.35, 0.7)
"""Downward tilts of the hand, radians."""
BAR = 0.02
"""How far the fingers reach over a bar, metres, at least."""
INSIDE = 0.03
"""Where a door is pushed: this far from its free edge, metres."""
BELOW = 0.03
"""How far fingers from above reach below the upper edge of a door that they push, metres."""
AT_END = 0.05
"""A door this near to its end has reached it, radians."""


def propose_swing_open(job: Job, door: Door) -> list[Proposal] | Abstention:
    """Grasp the handle, turn it if it is a lever, and pull it along the arc until a hand fits through."""
    handle, joint = door.handle, door.joint
    if handle is None or not len(handle.points):
        return Abstention("unknown_skill", f"The {door.panel.label} has no visible handle to pull.")
    left = np.inf if joint is None else joint.reach - joint.position
    if left < AT_END:
        return Abstention("other", f"The {door.panel.label} is open already.")
    bar = _bar(door)
    level = np.ptp(bar @ door.arm) > np.ptp(bar[:, 2])
    across = UP if level else door.arm
    width = float(np.ptp(np.quantile(bar @ across, [0.02, 0.98])))
    if width + PLAY > job.hand.max_width:
        message = f"{width * 1000:.0f} mm across; the hand opens {job.hand.max_width * 1000:.0f} mm."
        return Abstention("too_wide", f"The {handle.label} is {message}")
    found = []
    for share, lean, nod, sign in product(
        ALONG if door.lever is not None else (0.5,), LEANS, NODS, (1.0, -1.0)
    ):
        at = _on_bar(door, bar, share)
        into = Rotation.from_rotvec(lean * UP).apply(-door.out)
        tilt = Rotation.from_rotvec(nod * np.cross(into, -UP))
        how = f"leaning {np.degrees(lean):.0f}°, {np.degrees(nod):.0f}° down, {100 * share:.0f} % along"
        preference = 0.8 - 0.3 * abs(lean) - 0.3 * nod - 0.1 * (share != ALONG[0])
        closing = tilt.apply(across) if level else Rotation.from_rotvec(lean * UP).apply(across)
        opening = min(1.0, (width + 4 * job.grasp.snug) / job.hand.max_width)
        grasp = Grasp(how, "handle", sign * closing, tilt.apply(into), at, opening, preference, BAR)
        found.append(_opened(job, door, grasp, left))
    return found


def _bar(door: Door) -> FloatArray:
    """(N, 3) points of the handle's outer half: the bar without what holds it."""
    assert door.handle is not None
    off = door.handle.points @ door.out
    outer = float(np.quantile(off, 0.98))
    depth = min(0.5 * (outer - float(door.panel.centre @ door.out) - door.panel.half_along(door.out)), 0.04)
    return np.asarray(door.handle.points[off > outer - depth])


def _on_bar(door: Door, bar: FloatArray, share: float) -> FloatArray:
    """(3,) the point at a ``share`` of the bar, from where a lever turns, or from its end nearer to the hinge."""
    low, high = np.quantile(bar @ door.arm, [0.02, 0.98])
    if door.lever is not None and door.lever @ door.arm > 0.5 * (low + high):
        low, high = high, low
    middle = 0.5 * (np.quantile(bar, 0.05, axis=0) + np.quantile(bar, 0.95, axis=0))
    return np.asarray(middle + (low + share * (high - low) - middle @ door.arm) * door.arm)


def _opened(job: Job, door: Door, grasp: Grasp, left: float) -> Proposal:
    theta = job.theta
    radius = float(np.linalg.norm(np.cross(grasp.centre - door.origin, door.axis)))
    swing = min(theta["open_angle"], theta["pull_distance"] / radius if door.joint is None else left)

    def way() -> Trajectory:
        assert door.handle is not None
        near = job.resting | {door.panel.id, door.handle.id}  # its frame is beside it
        path = take(job, grasp, near, "reach")
        path.carries, path.tolerance = door.handle.id, GIVE
        now = grasp
        if door.lever is not None:
            bar = float(np.sign((grasp.centre - door.lever) @ door.arm)) * door.arm
            now = _along(path, now, door.lever, np.cross(bar, -UP), theta["lever_turn"], "turn", near)
        now = _along(path, now, door.origin, door.axis, swing, "swing", near)
        let_go(path, now.centre, now.centre - now.approach * theta["standoff"], grasp.opening, near)
        return path.trajectory()

    how = f"door swung open {np.degrees(swing):.0f}° by its handle, hand {grasp.description}"
    return Proposal(how, grasp.approaches, grasp.preference, way)


def _along(
    path: Path,
    grasp: Grasp,
    origin: FloatArray,
    axis: FloatArray,
    angle: float,
    stage: str,
    near: frozenset[str],
) -> Grasp:
    """Add waypoints by which the hand turns about an axis, and return the grasp at their end."""
    steps = max(1, int(np.ceil(abs(angle) / STEP - 1e-9)))
    now = grasp
    for k in range(1, steps + 1):
        turn = Rotation.from_rotvec(angle * k / steps * axis)
        at = origin + turn.apply(grasp.centre - origin)
        now = replace(
            grasp, centre=at, closing=turn.apply(grasp.closing), approach=turn.apply(grasp.approach)
        )
        path.orientation = now.orientation
        path.line(stage, now.centre, allowed=near, slow=True)
    return now


def propose_swing_shut(job: Job, door: Door) -> list[Proposal] | Abstention:
    """Push the face near the free edge along the arc with closed fingers."""
    joint = door.joint
    if joint is None:
        return Abstention("unknown_skill", f"How far the {door.panel.label} is open is not known.")
    if joint.position < AT_END:
        return Abstention("other", f"The {door.panel.label} is closed already.")
    near = job.resting | frozenset({door.panel.id, *([door.handle.id] if door.handle is not None else [])})
    off = door.panel.points - door.origin
    edge = off @ door.arm > door.reach - 2 * INSIDE
    thick = float(np.quantile(off[edge] @ door.out, 0.95))
    face = door.origin + (door.reach - INSIDE) * door.arm + thick * door.out

    def shut(
        how: str, contact: FloatArray, approach: FloatArray, closing: FloatArray, preference: float
    ) -> Proposal:
        grasp = Grasp(how, "side", closing, approach, contact, 0.0, preference)

        def way() -> Trajectory:
            theta = job.theta
            path = Path(theta["speed"], theta["contact_speed"], grasp.orientation, 0.0)
            path.tolerance = GIVE
            path.go("approach", contact - approach * theta["standoff"])
            path.line("touch", contact, allowed=near, slow=True)
            now = _along(path, grasp, door.origin, door.axis, -joint.position, "push", near)
            path.line("retreat", now.centre - now.approach * theta["standoff"], allowed=near)
            return path.trajectory()

        return Proposal(f"push the {door.panel.label} shut, hand {how}", grasp.approaches, preference, way)

    found = []
    for lean, nod, sign in product(LEANS, NODS, (1.0, -1.0)):
        into = Rotation.from_rotvec(lean * door.axis).apply(-door.out)
        approach = Rotation.from_rotvec(nod * np.cross(into, -UP)).apply(into)
        how, preference = (
            f"leaning {np.degrees(lean):.0f}°, {np.degrees(nod):.0f}° down",
            0.8 - 0.3 * abs(lean),
        )
        contact = face - job.hand.tip_beyond_tcp * approach
        found.append(shut(how, contact, approach, sign * door.axis, preference - 0.2 * nod))
    over = face + 0.5 * job.hand.finger_breadth * door.out
    over[2] = door.panel.top - BELOW + job.hand.tip_beyond_tcp
    for way_out, sign in product((door.out, door.arm), (1.0, -1.0)):
        closing = sign * np.cross(UP, way_out)
        found.append(shut("from above", over, -UP, closing, 0.5))
    return found
