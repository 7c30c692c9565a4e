"""Hinge: a lid swung open by its lip, or drawn shut by a hook behind its free edge.

The free edge moves on a circle about the hinge. The hand follows it through a handful of points: between two of them,
``STEP`` radians apart, the straight way leaves the circle by 2 mm at most for lids of everyday size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.trajectory import Trajectory
from gvla2.skills.mechanisms import CLOSED, UP, Hinge, hinge_for
from gvla2.skills.proposals import Job, Path, Proposal, pointing
from gvla2.skills.schemas.pick import Grasp, let_go, take

HandAt = Callable[[float, float, float], tuple[FloatArray, FloatArray]]
STEP = 0.22
GRIP_OPENING = 0.6
"""Of the hand before a lip is grasped: the fingers then fit between the lip and what stands near it."""
GIVE = 0.02
"""Tolerance along the arc, metres: the hinge decides where the edge goes, the arm yields."""
FALLS = 1.0
"""Seconds in which a lid that does not stay open falls: what is seen then is what it came to."""
TURNED = (0.0, 0.2, -0.2)
"""The hand may point this much up (or down) from along the lid when it grasps the lip, radians."""
YAWS = (0.35, -0.35)
"""How far the hand may come from beside straight when it grasps the lip, in the lid's plane, radians."""
SHIFTS = (0.0, 0.25, -0.25, 0.4, -0.4)
"""Where along the free edge the hand may take hold, as shares of its length from the middle."""


def propose_open(job: Job) -> list[Proposal] | Abstention:
    """Grasp the lip, fingers above and below, go round the hinge with it, let go."""
    hinge = hinge_for(job.theme, job.scene)
    if hinge is None:
        return Abstention("unknown_skill", f"No lid is seen on the {job.theme.label}: it cannot be opened.")
    if hinge.angle > 0.5 * np.pi:
        return Abstention("other", f"The {hinge.lid.label} is open already.")
    if hinge.thickness > 0.5 * job.hand.max_width:
        return Abstention("too_wide", f"The {hinge.lid.label} is too thick for the hand.")
    whole = job.theta["open_angle"]
    further = whole - 0.5 * np.pi
    less = whole - 0.5 * further
    hand_at = cache(partial(_hand_at, hinge))  # the same for every place along the lip
    ways: list[tuple[float, float, float, Sequence[float]]] = [(whole, lean, 0.0, SHIFTS) for lean in TURNED]
    ways += [(end, 0.0, 0.0, SHIFTS) for end in (whole - 0.25 * further, less)]
    ways += [(less, lean, yaw, SHIFTS[:3]) for yaw in YAWS for lean in TURNED]
    return [
        _open(job, hinge, hand_at, sign, lean, end, shift, yaw)
        for end, lean, yaw, shifts in ways
        for shift in shifts
        for sign in (1.0, -1.0)
    ]


def _hand_at(hinge: Hinge, angle: float, lean: float, yaw: float) -> tuple[FloatArray, FloatArray]:
    """Approach and closing direction, (3,) each, of a hand that holds the lip of a lid open by ``angle``."""
    tilt = Rotation.from_rotvec(lean * hinge.axis) * Rotation.from_rotvec(yaw * hinge.normal(angle))
    return tilt.apply(-hinge.out(angle)), tilt.apply(hinge.normal(angle))


def _angles(begin: float, end: float) -> FloatArray:
    """From one opening of the lid to another, in steps of :data:`STEP` at most."""
    return np.linspace(begin, end, max(2, int(np.ceil(abs(end - begin) / STEP)) + 1))


def _off_middle(hinge: Hinge, shift: float) -> str:
    return f", {abs(shift) * hinge.breadth * 100:.0f} cm beside its middle" if shift else ""


def _open(
    job: Job, hinge: Hinge, hand_at: HandAt, sign: float, lean: float, end: float, shift: float, yaw: float
) -> Proposal:
    wanted = job.theta["open_angle"]
    how = f"lid swung open {np.degrees(end):.0f}° by its lip" + (", hand turned over" if sign < 0 else "")
    how += f", tilted {np.degrees(lean):.0f}°" if lean else ""
    how += _off_middle(hinge, shift)
    how += f", from {np.degrees(yaw):.0f}° beside" if yaw else ""
    preference = 0.8 - 0.4 * abs(lean) - (wanted - end) - 0.3 * abs(shift) - 0.2 * abs(yaw)

    def way() -> Trajectory:
        theta, near = job.theta, hinge.parts

        def lip(angle: float) -> FloatArray:
            return hinge.edge(angle, theta["lip_depth"]) + shift * hinge.breadth * hinge.axis

        angles = [float(angle) for angle in _angles(hinge.angle, end)]
        at, (approach, closing) = lip(angles[0]), hand_at(angles[0], lean, yaw)
        grasp = Grasp(how, "lip", sign * closing, approach, at, GRIP_OPENING, preference, 0.0)
        path = take(job, grasp, near, "reach")
        path.carries, path.tolerance = hinge.lid.id, GIVE
        for angle in angles[1:]:
            at, (approach, closing) = lip(angle), hand_at(angle, lean, yaw)
            path.orientation = pointing(sign * closing, approach)
            path.line("swing", at, allowed=near, slow=True)
        let_go(path, at, at - approach * theta["standoff"], GRIP_OPENING, near, dwell=FALLS)
        return path.trajectory()

    notes = (
        ("The hinge's edge cannot be seen; the lid was assumed to open towards the robot.",)
        if hinge.guessed
        else ()
    )
    names = ("approach:side", "approach:lip")
    return Proposal(how, names, preference, way, notes, reserve=bool(yaw) or end < wanted)


BESIDE = (0.75, 0.55)
"""How far out along the lid the fingers push that reach behind it from beside, as shares of its length."""
ROLLS = (0.0, 0.5 * np.pi, -0.5 * np.pi, np.pi)
"""About its own direction a hand that only pushes may be turned any way, radians."""
INTO = 0.025
"""How far fingers reach behind a lid from beside it, metres."""


def propose_close(job: Job) -> list[Proposal] | Abstention:
    """Closed fingers behind the free edge, over the hinge with it; it falls the rest of the way. Or, where that edge
    is too far off, with the hand level beside the lid and its fingers behind it.
    """
    hinge = hinge_for(job.theme, job.scene)
    if hinge is None:
        return Abstention("unknown_skill", f"No lid is seen on the {job.theme.label}: it cannot be closed.")
    if hinge.angle < CLOSED:
        return Abstention("other", f"The {hinge.lid.label} is closed already.")
    hooks = [
        _close(job, hinge, sign, lean, shift)
        for lean in (0.0, 0.35, -0.35)
        for shift in SHIFTS[:3]
        for sign in (1.0, -1.0)
    ]
    beside = [
        _close_beside(job, hinge, side, roll, share)
        for share in BESIDE
        for side in (1.0, -1.0)
        for roll in ROLLS
    ]
    return [*hooks, *beside]


def _close(job: Job, hinge: Hinge, sign: float, lean: float, shift: float) -> Proposal:
    """The hand points down, its fingertips leaning by ``lean`` away from the box (negative: towards it), radians."""

    def way() -> Trajectory:
        theta = job.theta
        tilt = Rotation.from_rotvec(-lean * hinge.axis)
        approach, ahead = tilt.apply(-UP), tilt.apply(hinge.level)  # along the fingers, and square to them
        gap = 0.5 * job.hand.finger_breadth + 0.7 * hinge.thickness

        def hook(angle: float) -> FloatArray:
            at = hinge.edge(angle) + shift * hinge.breadth * hinge.axis
            return np.asarray(at - gap * ahead + theta["hook_depth"] * approach)

        path = Path(theta["speed"], theta["contact_speed"], pointing(sign * hinge.axis, approach), 0.0)
        first = hook(hinge.angle) - 0.03 * hinge.level
        path.go("approach", first - approach * theta["standoff"])
        path.line("lower", first, allowed=hinge.parts)
        last = _drive(job, hinge, path, "draw over", hook)
        path.line("retreat", last + 0.12 * UP, allowed=hinge.parts)
        return path.trajectory()

    how = "lid drawn shut from behind its edge" + (", hand turned round" if sign < 0 else "")
    how += f", leaning {np.degrees(lean):.0f}°" if lean else ""
    how += _off_middle(hinge, shift)
    preference = 0.8 - 0.4 * abs(lean) - 0.3 * abs(shift)
    return Proposal(how, ("approach:top", "approach:hook"), preference, way)


def _close_beside(job: Job, hinge: Hinge, side: float, roll: float, share: float) -> Proposal:
    """The hand points along the hinge, from one side of the lid; its closed fingers push the lid's back."""

    def way() -> Trajectory:
        theta, hand = job.theta, job.hand
        approach = -side * hinge.axis
        gap = 0.5 * max(hand.finger_breadth, 2 * hand.finger_thickness) + 0.7 * hinge.thickness
        rim = side * (0.5 * hinge.breadth - INTO - hand.tip_beyond_tcp) * hinge.axis

        def behind(angle: float, more: float = 0.0) -> FloatArray:
            on = hinge.origin + share * hinge.reach * hinge.out(angle) + rim
            return np.asarray(on + (gap + more) * hinge.normal(angle))

        orientation = pointing(Rotation.from_rotvec(roll * approach).apply(UP), approach)
        path = Path(theta["speed"], theta["contact_speed"], orientation, 0.0)
        first, aside = behind(hinge.angle, 0.02), approach * (INTO + theta["standoff"])
        path.go("approach", first - aside)
        path.line("reach behind", first, allowed=hinge.parts)
        last = _drive(job, hinge, path, "push over", behind)
        away = last + 0.03 * hinge.normal(_let_go_angle(job, hinge)) - aside
        path.line("retreat", away, allowed=hinge.parts)
        return path.trajectory()

    where = "left" if side > 0 else "right"
    how = f"lid pushed shut from its {where} side, hand turned {np.degrees(roll):.0f}°"
    preference = 0.6 - 0.2 * (BESIDE[0] - share)
    return Proposal(how, ("approach:side", "approach:hook"), preference, way, reserve=True)


def _let_go_angle(job: Job, hinge: Hinge) -> float:
    return min(job.theta["let_go_angle"], hinge.angle)


def _drive(job: Job, hinge: Hinge, path: Path, stage: str, hand: Callable[[float], FloatArray]) -> FloatArray:
    """Take the lid along, with the tool at ``hand(angle)`` (3,), until it falls by itself; where the tool is then."""
    path.tolerance = GIVE
    for angle in _angles(hinge.angle, _let_go_angle(job, hinge)):
        path.line(stage, hand(float(angle)), allowed=hinge.parts, slow=True)
    return np.asarray(path.waypoints[-1].xyz)
