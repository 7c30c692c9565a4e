"""Twist: grasp a cap from above, turn it with the wrist until it is loose, lift it, and put it down if asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Trajectory
from gvla2.skills.grasps import grasps, spans
from gvla2.skills.proposals import Grasp, horizontal, pointing
from gvla2.skills.schemas.pick_place import FREE_TURNS, carry, goal_spots, over_spot, put_down, take

STEP = np.deg2rad(45.0)
"""Largest step of the wrist, so that the direction of the turn is unambiguous."""
ASKEW = 8.0
"""Deduction from the preference for each metre beyond the cap's least width: fingers hold flats best."""
SIDES = 12


def propose_twist(job: Job) -> list[Proposal] | Abstention:
    """Each yaw of the hand that fits around the cap; with a goal, each spot and turn there, too."""
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
