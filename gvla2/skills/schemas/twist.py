"""Twist: grasp a cap from above, turn it with the wrist until it is loose, lift it, and put it down if asked; or turn a
knob about its known axis, and let go.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import PartJoint
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Trajectory, grasp_rotation
from gvla2.skills.grasps import FEWEST, grasps, spans
from gvla2.skills.mechanisms import UP
from gvla2.skills.proposals import STEEP, Grasp, horizontal, pointing
from gvla2.skills.schemas.pick_place import FREE_TURNS, carry, goal_spots, let_go, over_spot, put_down, take

STEP = np.deg2rad(45.0)
"""Largest step of the wrist, so that the direction of the turn is unambiguous."""
ASKEW = 8.0
"""Deduction from the preference for each metre beyond the cap's least width: fingers hold flats best."""
SIDES = 12
GIVE = 0.02
"""Tolerance while a knob is turned, metres: its axis guides it, and the arm yields."""
STILL = 0.1
"""A smaller turn of a knob is none, radians."""


def propose_twist(job: Job) -> list[Proposal] | Abstention:
    """Each yaw of the hand that fits around the cap; with a goal, each spot and turn there, too."""
    if (joint := job.theme.joint) is not None and not joint.slides:
        return _turned_knob(job, joint)
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    down = [g for g in _yaws(job, found) if g.family == "top"]
    proposals = []
    for grasp in down:
        if job.goal is None and job.target is None:
            proposals.append(_twist(job, grasp))
            continue
        for spot, name in goal_spots(job):
            proposals += [_twist(job, grasp, spot, name, turn) for turn in FREE_TURNS]
    return proposals


DEPTHS = (0.03, 0.025, 0.02, 0.015, 0.01)
"""How far the fingertips reach over a knob, metres, best first."""
NARROW = 12
"""Number of the narrowest widths of a knob that are tried at each depth."""
SHARES = (1.0, 0.75, 0.5)
"""Shares of a turn that are tried: a switch may need less than its whole way."""


def _turned_knob(job: Job, joint: PartJoint) -> list[Proposal] | Abstention:
    """Grasps across the narrowest parts of the knob's outer end, with the tool on its axis."""
    turn = float(np.clip(job.theta["turn"], -joint.position, joint.reach - joint.position))
    knob, hand = job.theme, job.hand
    if joint.position + turn < STILL:
        turn -= STILL  # to its stop: where off is may be seen a little off
    elif abs(turn) < STILL:
        return Abstention("other", f"The {knob.label} is turned as far already.")
    whole = job.scene.whole_of(knob)
    middle = knob.centre - (whole.centre if whole is not None else job.scene.table_height * UP)
    out = joint.axis if joint.axis @ (middle if abs(joint.axis[2]) < STEEP else UP) >= 0 else -joint.axis
    rotation = grasp_rotation(-out, np.cross(out, [1.0, 0.0, 0.0] if abs(out[0]) < STEEP else UP))
    local = (knob.points - joint.origin) @ rotation  # the hand's frame on the axis: z into the knob
    outer = float(local[:, 2].min())
    found = list[Proposal]()
    for depth in DEPTHS:
        end = local[local[:, 2] < outer + depth, :2]
        if len(end) < FEWEST:
            continue
        angles = np.pi * np.arange(SIDES) / SIDES
        low, high = np.array([(np.min(end @ way), np.max(end @ way)) for way in _ways(angles)]).T
        for k in np.argsort(high - low)[:NARROW]:
            width, offset = float(high[k] - low[k]), float(0.5 * (high[k] + low[k]))
            if width + job.grasp.clearance + 2 * abs(offset) > hand.max_width:
                continue
            closing = rotation[:, :2] @ _ways(angles[k : k + 1])[0]
            at = joint.origin - out * (outer + depth - hand.tip_beyond_tcp) + offset * closing
            preference = 0.8 - 2.0 * (DEPTHS[0] - depth) - ASKEW * (width - float((high - low).min())) / 4
            how = f"knob turned, {1e3 * width:.0f} mm across, {1e3 * depth:.0f} mm deep"
            for sign, share in product((1.0, -1.0), SHARES):
                better = preference - 0.3 * (1.0 - share)
                grasp = Grasp(how, "top", sign * closing, -out, at, 1.0, better, depth, width)
                found.append(_turn(job, joint, grasp, share * turn))
    if found:
        return found
    return Abstention("too_wide", f"The {knob.label} is too wide for the hand at any depth.")


def _ways(angles: FloatArray) -> FloatArray:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _turn(job: Job, joint: PartJoint, grasp: Grasp, turn: float) -> Proposal:
    """Grasp, turn about the axis in steps, let go."""

    def way() -> Trajectory:
        touching = frozenset({job.theme.id, job.theme.parent} - {""})
        path = take(job, grasp, touching)
        path.carries, path.tolerance = "", GIVE
        steps = int(np.ceil(abs(turn) / STEP - 1e-9))
        for k in range(1, steps + 1):
            by = Rotation.from_rotvec(turn * k / steps * joint.axis)
            path.orientation = pointing(by.apply(grasp.closing), grasp.approach)
            path.line("turn", joint.origin + by.apply(grasp.centre - joint.origin), allowed=touching)
        away = path.end - grasp.approach * (job.theta["standoff"] + (grasp.back or 0.0))
        let_go(path, path.end, away, 1.0, touching)
        return path.trajectory()

    return Proposal(
        f"{grasp.description}, by {np.degrees(turn):.0f}°", grasp.approaches, grasp.preference, way
    )


def _yaws(job: Job, found: list[Grasp]) -> list[Grasp]:
    """The grasps of a box; for any other shape grasps at finer yaws, best at the least width."""
    if job.theme.shape == "box" or not found:
        return found
    axes, points = job.theme.world_from_object, job.theme.points[:, :2]
    start = float(np.arctan2(axes[1, 0], axes[0, 0]))
    angles = start + 2 * np.pi * np.arange(SIDES) / SIDES
    widths = np.ptp(spans(points, angles), axis=0) if len(points) else np.zeros(SIDES)
    grasps = []
    for grip in {g.opening: g for g in found if g.family == "top"}.values():
        for angle, width in zip(angles, widths, strict=True):
            worse = ASKEW * float(width - widths.min())
            name = f"grasp from above, yaw {np.degrees(angle) % 360:.0f}°"
            closing, preference = horizontal(float(angle)), grip.preference - worse
            grasps.append(replace(grip, description=name, closing=closing, preference=preference))
    return grasps


def _twist(
    job: Job, grasp: Grasp, spot: FloatArray | None = None, where: str = "", turn: float = 0.0
) -> Proposal:
    theta, theme = job.theta, job.theme
    rest = theta["turn"] - job.done.get("turn", 0.0)

    def way() -> Trajectory:
        touching = job.own | job.resting | ({theme.parent} - {""})
        path = take(job, grasp, touching)
        path.carries = ""  # it stays in place until it is loose
        steps = int(np.ceil(abs(rest) / STEP - 1e-9))
        closing = grasp.closing
        for k in range(1, steps + 1):
            closing = Rotation.from_euler("z", rest * k / steps).apply(grasp.closing)
            path.orientation = pointing(closing, grasp.approach)
            path.line("turn", grasp.centre, allowed=touching, slow=True)
        path.carries = theme.id
        up = grasp.centre + np.array([0.0, 0.0, theta["lift_height"]])
        path.line("lift", np.minimum(up, [np.inf, np.inf, job.ceiling()]), allowed=touching)
        if spot is not None:
            turned = replace(grasp, closing=closing)
            over = over_spot(job, turned, spot, turn)
            carry(path, over)
            put_down(job, path, turned, over, spot)
        return path.trajectory()

    how = f"{grasp.description}, turned by {np.degrees(rest):.0f}°" + (f"; put down {where}" if where else "")
    return Proposal(how, grasp.approaches, grasp.preference - 0.02 * (turn != 0.0), way)
