"""Lifted paths with a grasp: by the nearest grasps, along the points, and put down."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.skills.proposals import Job, Path, Proposal
from gvla2.skills.schemas.insert import aligning_turns, lower_over
from gvla2.skills.schemas.pick import Grasp, draw_out, grasps, take
from gvla2.skills.schemas.place import TURNS, carry, over_spot, put_down
from gvla2.skills.stuck import stuck

if TYPE_CHECKING:
    from gvla2.skills.lifting import PathPoint

NEAREST = 24
"""The number of grasps, nearest to the point where the hand closes, that are considered."""
APPROACH = 0.12
"""Points within this horizontal distance of the grasp belong to its approach or retreat, metres."""
CENTRED = 0.03
"""An object released this close to a goal's middle is put down at the middle, metres."""
LOWERED = 0.03
"""A point over the release that is higher by less belongs to it, metres."""
FAR = 10.0
"""Deduction from the preference for each metre between grasp and point."""
TURNED = 0.05
STEEP = 0.7
"""A motion is vertical if its height changes by more than this share of its length."""


def carried(
    job: Job, points: Sequence[PathPoint], at: int, opened: int | None
) -> list[Proposal] | Abstention:
    """One proposal for each grasp and turn: the hand closes at point ``at`` and opens at ``opened`` (None: never)."""
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    point = points[at].array

    def cost(grasp: Grasp) -> float:
        return FAR * float(np.linalg.norm((grasp.centre - point)[:2])) - grasp.preference

    turns: Sequence[float] = TURNS if opened is not None else TURNS[:1]
    if job.skill == "insert" and job.goal is not None:
        turns = aligning_turns(job.theme, job.goal)
    return [
        _along(job, points, at, opened, grasp, turn, -cost(grasp))
        for grasp in sorted(found, key=cost)[:NEAREST]
        for turn in turns
    ]


def _along(
    job: Job,
    points: Sequence[PathPoint],
    at: int,
    opened: int | None,
    grasp: Grasp,
    turn: float,
    preference: float,
) -> Proposal:
    path = take(job, grasp)
    before = Path(path.speed, path.contact_speed, path.orientation)
    for point in points[:at]:
        if float(np.linalg.norm((point.array - grasp.centre)[:2])) > APPROACH:
            before.go("move", point.array)
    path.waypoints[:0] = before.waypoints
    held = stuck(job.theme, job.scene)
    touching = job.own() | job.resting() | (held.holders if held is not None else frozenset())
    here = draw_out(job, path, grasp)
    clear = max(job.rise - float(here[2] - grasp.centre[2]), 0.0)
    end = len(points) if opened is None else opened
    while opened is not None and end > at + 1 and _released_at(points[end - 1].array, points[opened].array):
        end -= 1  # putting down leads there, and knows what may be touched
    for k, point in enumerate(points[at + 1 : end]):
        there = np.minimum(point.array, [np.inf, np.inf, job.ceiling()])
        if k == 0 and opened is None and at + 2 == end:
            there[2] = max(there[2], here[2] + clear)
        if float(np.linalg.norm(there - here)) < 1e-3:
            continue
        steep = abs(float(there[2] - here[2])) > STEEP * float(np.linalg.norm(there - here))
        if k == 0 or steep:
            path.line("lift" if there[2] > here[2] else "carry", there, allowed=touching)
        else:
            path.go("carry", there)
        here = there
    if opened is not None:
        _let_go(job, path, points[opened], grasp, turn, here, touching)
        for point in points[opened + 1 :]:
            away = np.asarray(path.waypoints[-1].xyz)
            if float(np.linalg.norm(point.array - away)) > APPROACH:
                path.go("leave", point.array)
    how = grasp.description + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    cost = TURNED * (turn != 0.0)
    return Proposal(how, grasp.approaches, preference - cost, path.trajectory())


def _released_at(point: FloatArray, spot: FloatArray) -> bool:
    """Whether a point is the place of the release itself, and no more than lowered there."""
    return float(np.linalg.norm((point - spot)[:2])) < CENTRED and float(point[2] - spot[2]) < LOWERED


def _let_go(
    job: Job,
    path: Path,
    point: PathPoint,
    grasp: Grasp,
    turn: float,
    here: FloatArray,
    touching: frozenset[str],
) -> None:
    """Go over the place, lower and open the hand; at the goal's middle if the point is close to it."""
    spot = point.array
    if job.goal is not None and float(np.linalg.norm((spot - job.goal.centre)[:2])) < CENTRED:
        spot = job.goal.centre
    support = job.scene.table_height
    if job.goal is not None and job.goal.shape != "region":
        support = job.goal.top
    spot = np.array([*spot[:2], support])
    over = over_spot(job, grasp, spot, turn)
    if here[2] < over.centre[2] - 1e-3:
        path.line("lift", np.array([*here[:2], over.centre[2]]), allowed=touching)
    carry(path, over)
    if job.skill == "insert":
        lower_over(job, path, grasp, over.centre)
    else:
        put_down(job, path, grasp, over, spot)
