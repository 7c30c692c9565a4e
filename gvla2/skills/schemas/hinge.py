"""Hinge: swing a lid open by its lip, or push it shut from behind its free edge.

The free edge moves on a circle about the hinge. The hand follows it through points ``STEP`` radians apart: for lids of
everyday size, the straight lines between them are within 2 mm of the circle.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Trajectory
from gvla2.skills.mechanisms import CLOSED, UP, Hinge, door_for, hinge_for, slide_for
from gvla2.skills.proposals import Grasp, Path, pointing
from gvla2.skills.schemas.door import propose_swing_open, propose_swing_shut
from gvla2.skills.schemas.pick_place import let_go, take
from gvla2.skills.schemas.pull import propose_shut

HandAt = Callable[[float, float], tuple[FloatArray, FloatArray]]
STEP = 0.22
GRIP_OPENING = 0.6
"""The hand's opening before it grasps a lip: the fingers then fit between the lip and what is close to it."""
GIVE = 0.02
"""Tolerance along the arc, metres: the hinge guides the edge, and the arm yields."""
FALLS = 1.0
"""Time for a lid to fall if it does not stay open, seconds, before the robot looks again."""
TURNED = (0.0, 0.2, -0.2)
"""Pitches of the hand, relative to the lid, when it grasps the lip, radians."""
SHIFTS = (0.0, 0.25, -0.25, 0.4, -0.4)
"""Places along the free edge to grasp, as shares of its length from the middle."""


def propose_open(job: Job) -> list[Proposal] | Abstention:
    """Grasp the lip, fingers above and below, swing it about the hinge, let go."""
    if (door := door_for(job.theme, job.scene)) is not None:
        return propose_swing_open(job, door)
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
    ways = [(whole, lean) for lean in TURNED] + [(end, 0.0) for end in (whole - 0.25 * further, less)]
    return [
        _open(job, hinge, hand_at, sign, lean, end, shift)
        for end, lean in ways
        for shift in SHIFTS
        for sign in (1.0, -1.0)
    ]


def _hand_at(hinge: Hinge, angle: float, lean: float) -> tuple[FloatArray, FloatArray]:
    """Approach and closing direction, (3,) each, of a hand on the lip of a lid open by ``angle``."""
    tilt = Rotation.from_rotvec(lean * hinge.axis)
    return tilt.apply(-hinge.out(angle)), tilt.apply(hinge.normal(angle))


def _angles(begin: float, end: float) -> FloatArray:
    """Opening angles of the lid from ``begin`` to ``end``, in steps of :data:`STEP` at most, radians."""
    return np.linspace(begin, end, max(2, int(np.ceil(abs(end - begin) / STEP)) + 1))


def _off_middle(hinge: Hinge, shift: float) -> str:
    return f", {abs(shift) * hinge.breadth * 100:.0f} cm beside its middle" if shift else ""


def _open(
    job: Job, hinge: Hinge, hand_at: HandAt, sign: float, lean: float, end: float, shift: float
) -> Proposal:
    wanted = job.theta["open_angle"]
    how = f"lid swung open {np.degrees(end):.0f}° by its lip" + (", hand turned over" if sign < 0 else "")
    how += f", tilted {np.degrees(lean):.0f}°" if lean else ""
    how += _off_middle(hinge, shift)
    preference = 0.8 - 0.4 * abs(lean) - (wanted - end) - 0.3 * abs(shift)

    def way() -> Trajectory:
        theta, near = job.theta, hinge.parts

        def lip(angle: float) -> FloatArray:
            return hinge.edge(angle, theta["lip_depth"]) + shift * hinge.breadth * hinge.axis

        angles = [float(angle) for angle in _angles(hinge.angle, end)]
        at, (approach, closing) = lip(angles[0]), hand_at(angles[0], lean)
        grasp = Grasp(how, "lip", sign * closing, approach, at, GRIP_OPENING, preference, 0.0)
        path = take(job, grasp, near, "reach")
        path.carries, path.tolerance = hinge.lid.id, GIVE
        for angle in angles[1:]:
            at, (approach, closing) = lip(angle), hand_at(angle, lean)
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
    return Proposal(how, names, preference, way, notes, reserve=end < wanted)


def propose_close(job: Job) -> list[Proposal] | Abstention:
    """Move the lid with closed fingers behind its free edge until it falls by itself."""
    if (door := door_for(job.theme, job.scene)) is not None:
        return propose_swing_shut(job, door)
    hinge, slide = hinge_for(job.theme, job.scene), slide_for(job.theme, job.scene)
    if slide is not None and (hinge is None or slide.front.id == job.theme.id):
        return propose_shut(job, slide)
    if hinge is None:
        return Abstention("unknown_skill", f"No lid is seen on the {job.theme.label}: it cannot be closed.")
    if hinge.angle < CLOSED:
        return Abstention("other", f"The {hinge.lid.label} is closed already.")
    return [
        _close(job, hinge, sign, lean, shift)
        for lean in (0.0, 0.35, -0.35)
        for shift in SHIFTS[:3]
        for sign in (1.0, -1.0)
    ]


def _close(job: Job, hinge: Hinge, sign: float, lean: float, shift: float) -> Proposal:
    """The hand points down, its fingertips tilted by ``lean`` radians away from the box (negative: towards it)."""

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
        path.tolerance = GIVE
        for angle in _angles(hinge.angle, min(theta["let_go_angle"], hinge.angle)):
            path.line("draw over", hook(float(angle)), allowed=hinge.parts, slow=True)
        path.line("retreat", path.end + 0.12 * UP, allowed=hinge.parts)
        return path.trajectory()

    how = "lid drawn shut from behind its edge" + (", hand turned round" if sign < 0 else "")
    how += f", leaning {np.degrees(lean):.0f}°" if lean else ""
    how += _off_middle(hinge, shift)
    preference = 0.8 - 0.4 * abs(lean) - 0.3 * abs(shift)
    return Proposal(how, ("approach:top", "approach:hook"), preference, way)
