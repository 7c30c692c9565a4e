"""Hinge: a lid swung open by its lip, or drawn shut by a hook behind its free edge.

The free edge moves on a circle about the hinge. The hand follows it through a handful of points: between two of them,
``STEP`` radians apart, the straight way leaves the circle by 2 mm at most for lids of everyday size.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.trajectory import Trajectory
from gvla2.skills.mechanisms import CLOSED, UP, Hinge, hinge_for
from gvla2.skills.proposals import Job, Path, Proposal, pointing

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
    straight = [
        _open(job, hinge, hand_at, sign, lean, end, shift)
        for end, leans in ((whole, TURNED), (whole - 0.25 * further, TURNED[:1]), (less, TURNED[:1]))
        for lean in leans
        for shift in SHIFTS
        for sign in (1.0, -1.0)
    ]
    askew = [
        _open(job, hinge, hand_at, sign, lean, less, shift, yaw)
        for yaw in YAWS
        for lean in TURNED
        for shift in SHIFTS[:3]
        for sign in (1.0, -1.0)
    ]
    return [*straight, *askew]


def _hand_at(hinge: Hinge, angle: float, lean: float, yaw: float) -> tuple[FloatArray, FloatArray]:
    """Approach and closing direction, (3,) each, of a hand that holds the lip of a lid open by ``angle``."""
    tilt = Rotation.from_rotvec(lean * hinge.axis) * Rotation.from_rotvec(yaw * hinge.normal(angle))
    return tilt.apply(-hinge.out(angle)), tilt.apply(hinge.normal(angle))


def _open(
    job: Job,
    hinge: Hinge,
    hand_at: HandAt,
    sign: float,
    lean: float,
    end: float,
    shift: float,
    yaw: float = 0.0,
) -> Proposal:
    def way() -> Trajectory:
        theta, near = job.theta, hinge.parts
        aside = shift * hinge.breadth * hinge.axis
        steps = max(2, int(np.ceil((end - hinge.angle) / STEP)) + 1)
        angles = np.linspace(hinge.angle, end, steps)
        path = Path(theta["speed"], theta["contact_speed"])

        def turn(angle: float) -> FloatArray:
            approach, closing = hand_at(angle, lean, yaw)
            path.orientation = pointing(sign * closing, approach)
            return approach

        lip = hinge.edge(float(angles[0]), theta["lip_depth"]) + aside
        approach = turn(float(angles[0]))
        path.go("approach", lip - approach * theta["standoff"], gripper=GRIP_OPENING)
        path.line("reach", lip, allowed=near, slow=True)
        path.line("close", lip, gripper=0.0, allowed=near, slow=True)
        path.carries, path.tolerance = hinge.lid.id, GIVE
        for angle in angles[1:]:
            approach = turn(float(angle))
            path.line("swing", hinge.edge(float(angle), theta["lip_depth"]) + aside, allowed=near, slow=True)
        last = hinge.edge(end, theta["lip_depth"]) + aside
        path.line("release", last, gripper=GRIP_OPENING, allowed=near, slow=True)
        path.carries = ""
        path.line("retreat", last - approach * theta["standoff"], allowed=near, dwell=FALLS)
        return path.trajectory()

    how = f"lid swung open {np.degrees(end):.0f}° by its lip" + (", hand turned over" if sign < 0 else "")
    how += f", tilted {np.degrees(lean):.0f}°" if lean else ""
    how += f", {abs(shift) * hinge.breadth * 100:.0f} cm beside its middle" if shift else ""
    how += f", from {np.degrees(yaw):.0f}° beside" if yaw else ""
    wanted = job.theta["open_angle"]
    preference = 0.8 - 0.4 * abs(lean) - (wanted - end) - 0.3 * abs(shift) - 0.2 * abs(yaw)
    notes = (
        ("Which edge the hinge is at cannot be seen; the lid was taken to open towards the robot.",)
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
        theta, near, hand = job.theta, hinge.parts, job.hand
        path = Path(theta["speed"], theta["contact_speed"], gripper=0.0)
        behind = -hinge.level
        approach = Rotation.from_rotvec(-lean * hinge.axis).as_matrix() @ -UP
        closing = sign * hinge.axis
        path.orientation = pointing(closing, approach)
        ahead = Rotation.from_rotvec(-lean * hinge.axis).as_matrix() @ hinge.level  # square to the fingers
        gap = 0.5 * hand.finger_breadth + 0.7 * hinge.thickness
        end = min(theta["let_go_angle"], hinge.angle)
        angles = np.linspace(hinge.angle, end, max(2, int(np.ceil((hinge.angle - end) / STEP)) + 1))

        def hook(angle: float) -> FloatArray:
            at = hinge.edge(angle) + shift * hinge.breadth * hinge.axis
            return np.asarray(at - gap * ahead + theta["hook_depth"] * approach)

        first = hook(float(angles[0])) + 0.03 * behind
        path.go("approach", first - approach * theta["standoff"])
        path.line("lower", first, allowed=near)
        path.tolerance = GIVE
        for angle in angles:
            path.line("draw over", hook(float(angle)), allowed=near, slow=True)
        last = hook(float(angles[-1]))
        path.line("retreat", last + 0.12 * UP, allowed=near)
        return path.trajectory()

    how = "lid drawn shut from behind its edge" + (", hand turned round" if sign < 0 else "")
    how += f", leaning {np.degrees(lean):.0f}°" if lean else ""
    how += f", {abs(shift) * hinge.breadth * 100:.0f} cm beside its middle" if shift else ""
    preference = 0.8 - 0.4 * abs(lean) - 0.3 * abs(shift)
    return Proposal(how, ("approach:top", "approach:hook"), preference, way)


def _close_beside(job: Job, hinge: Hinge, side: float, roll: float, share: float) -> Proposal:
    """The hand points along the hinge, from one side of the lid; its closed fingers push the lid's back."""

    def way() -> Trajectory:
        theta, near, hand = job.theta, hinge.parts, job.hand
        path = Path(theta["speed"], theta["contact_speed"], gripper=0.0)
        approach = -side * hinge.axis
        path.orientation = pointing(Rotation.from_rotvec(roll * approach).apply(UP), approach)
        gap = 0.5 * max(hand.finger_breadth, 2 * hand.finger_thickness) + 0.7 * hinge.thickness
        end = min(theta["let_go_angle"], hinge.angle)
        angles = np.linspace(hinge.angle, end, max(2, int(np.ceil((hinge.angle - end) / STEP)) + 1))
        rim = side * (0.5 * hinge.breadth - INTO - hand.tip_beyond_tcp) * hinge.axis

        def behind(angle: float, more: float = 0.0) -> FloatArray:
            on = hinge.origin + share * hinge.reach * hinge.out(angle) + rim
            return np.asarray(on + (gap + more) * hinge.normal(angle))

        begin = float(angles[0])
        path.go("approach", behind(begin, 0.02) - approach * (INTO + theta["standoff"]))
        path.line("reach behind", behind(begin, 0.02), allowed=near)
        path.tolerance = GIVE
        for angle in angles:
            path.line("push over", behind(float(angle)), allowed=near, slow=True)
        path.line(
            "retreat", behind(float(angles[-1]), 0.03) - approach * (INTO + theta["standoff"]), allowed=near
        )
        return path.trajectory()

    where = "left" if side > 0 else "right"
    how = f"lid pushed shut from its {where} side, hand turned {np.degrees(roll):.0f}°"
    preference = 0.6 - 0.2 * (BESIDE[0] - share)
    return Proposal(how, ("approach:side", "approach:hook"), preference, way, reserve=True)
