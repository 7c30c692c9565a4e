"""Place: pick, carry over everything, lower, let go, back up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import ROUND, SceneObject
from gvla2.planning.trajectory import Trajectory
from gvla2.skills.proposals import Job, Path, Proposal
from gvla2.skills.schemas.pick import Grasp, draw_out, grasps, let_go, take

TURNS = (0.0, 0.5 * np.pi, -0.5 * np.pi)
"""Turns of the object on its way, radians: one may be within the wrist's limits if another is not."""
FLOOR = 0.01
"""Assumed thickness of a container's floor that was not seen, metres."""
ALIKE = 1.15
"""An object whose sides differ by less than this factor may lie either way."""
SIDE_GAP = 0.03
"""Gap between objects put beside one another, metres: room for a finger."""


def propose_place(job: Job) -> list[Proposal] | Abstention:
    """Each grasp with each spot and turn of the object at the goal."""
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    turns, spots = _turns(job), goal_spots(job)
    return [_place(job, grasp, spot, name, turn) for grasp in found for spot, name in spots for turn in turns]


def _turns(job: Job) -> list[float]:
    """Turns of the theme on its way, radians. If it shares the goal with others, it lies across the row that they stand
    in, which leaves them the most room.
    """
    theme, goal = job.theme, job.goal
    if theme.shape in ROUND:
        return [0.0]
    level = [i for i in range(3) if abs(theme.world_from_object[2, i]) < 0.5]
    if job.share[1] == 1 or goal is None or len(level) != 2:
        return list(TURNS)
    long, short = sorted(level, key=lambda i: -theme.extents[i])
    along, line = theme.world_from_object[:2, long], goal.world_from_object[:2, 0]
    across = float(np.arctan2(line[1], line[0]) - np.arctan2(along[1], along[0]) + 0.5 * np.pi)
    quarters = range(4) if theme.extents[long] < ALIKE * theme.extents[short] else (0, 2)
    turns = [float((across + 0.5 * np.pi * k + np.pi) % (2 * np.pi) - np.pi) for k in quarters]
    return sorted(turns, key=abs)


def goal_spots(job: Job) -> list[tuple[FloatArray, str]]:
    """Spots for the theme's centre (x, y, and the support's height z), each with its description, best first."""
    table = job.scene.table_height
    if job.target is not None:
        return [(np.array([*job.target, table]), "there")]
    if job.goal is None:
        raise ValueError("A goal or a target is needed to place something.")
    goal, theme = job.goal, job.theme
    if job.relation in ("on", "in", "to"):
        support = table if goal.shape == "region" else goal.top
        return [(np.array([*(goal.centre + _share(job, goal))[:2], support]), "onto it")]
    sides = {
        "left_of": ("left",), "right_of": ("right",), "behind": ("far",), "front_of": ("near",),
    }.get(job.relation, ("left", "right", "near", "far"))  # fmt: skip
    ways = {"left": (0.0, 1.0), "right": (0.0, -1.0), "far": (1.0, 0.0), "near": (-1.0, 0.0)}
    spots = []
    for side in sides:
        way = np.array([*ways[side], 0.0])
        # Half the diagonal of the theme, since it may be turned.
        reach = goal.half_along(way) + 0.5 * np.linalg.norm(theme.extents[:2])
        spot = goal.centre + way * (reach + SIDE_GAP)
        spots.append((np.array([*spot[:2], table]), f"at its {side} side"))
    return spots


def _share(job: Job, goal: SceneObject) -> FloatArray:
    """(3,) from the goal's middle to the place of the k-th of several objects in it."""
    rank, count = job.share
    along = 0.44 * (rank - 0.5 * (count - 1)) * (goal.opening or float(goal.extents[:2].min()))
    return np.asarray(along * goal.world_from_object[:3, 0])


def support_of(job: Job, grasp: Grasp, spot: FloatArray) -> float:
    """The height of the theme's support at the spot: inside a container, as low as the hand fits."""
    goal, theme, hand = job.goal, job.theme, job.hand
    if goal is None or spot[2] < goal.top - 1e-6 or theme.extents[:2].max() > goal.opening:
        return float(spot[2])
    local = transform_points(invert_rigid(goal.world_from_object), goal.points)
    within = (
        goal.points[(np.abs(local[:, :2]) < 0.4 * goal.opening).all(axis=1)] if len(local) else goal.points
    )
    floor = float(np.median(within[:, 2])) if len(within) else goal.bottom + FLOOR
    hangs = grasp.centre[2] - theme.bottom
    palm = goal.top + 0.01 - (hand.finger_length - hand.tip_beyond_tcp) - hangs
    aside = float(np.abs(spot[:2] - goal.centre[:2]).max())
    spread = 0.5 * hand.max_width * grasp.opening + hand.finger_thickness + 0.01
    tips = goal.top + 0.004 + hand.tip_beyond_tcp - hangs if aside + spread > 0.5 * goal.opening else floor
    return float(min(goal.top, max(floor, palm, tips)))


def _place(job: Job, grasp: Grasp, spot: FloatArray, where: str, turn: float) -> Proposal:
    def way() -> Trajectory:
        path, over = brought(job, grasp, spot, turn)
        put_down(job, path, grasp, over, spot)
        return path.trajectory()

    how = f"{grasp.description}; put down {where}" + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    preference = grasp.preference - 0.05 * (turn != 0.0)
    if job.share[1] > 1 and job.goal is not None:  # fingers between the objects need room, too
        closing = Rotation.from_euler("z", turn).apply(grasp.closing)
        preference -= 0.1 * abs(float(closing @ job.goal.world_from_object[:3, 0]))
    return Proposal(how, grasp.approaches, preference, way)


def brought(job: Job, grasp: Grasp, spot: FloatArray, turn: float) -> tuple[Path, Grasp]:
    """The path from the approach to over the spot (3,), with the theme turned by ``turn``, and the grasp there."""
    path, over = take(job, grasp), over_spot(job, grasp, spot, turn)
    out = draw_out(job, path, grasp)
    path.line("lift", np.array([*out[:2], over.centre[2]]), allowed=job.own() | job.resting())
    carry(path, over)
    return path, over


def over_spot(job: Job, grasp: Grasp, spot: FloatArray, turn: float) -> Grasp:
    """The grasp when the theme, turned by ``turn``, is over the spot (3,) and above everything."""
    theme = job.theme
    hangs = grasp.centre[2] - theme.bottom  # from the tool down to the object's underside
    height = min(max(job.highest, theme.bottom) + job.theta["transit_clearance"] + hangs, job.ceiling())
    rotation = Rotation.from_euler("z", turn)
    offset = rotation.apply(grasp.centre - theme.centre)
    over = np.array([*(spot + offset)[:2], height])
    closing, approach = rotation.apply(grasp.closing), rotation.apply(grasp.approach)
    return replace(grasp, centre=over, closing=closing, approach=approach)


def carry(path: Path, over: Grasp) -> None:
    """Turn the hand to its orientation at the goal, and go over it."""
    path.orientation = over.orientation
    path.go("transit", over.centre)


def put_down(job: Job, path: Path, grasp: Grasp, over: Grasp, spot: FloatArray) -> None:
    """From over the spot (3,): lower, let go, retreat along the approach."""
    theta, hangs = job.theta, grasp.centre[2] - job.theme.bottom
    height = support_of(job, grasp, spot) + theta["place_height"] + hangs
    down = np.array([*over.centre[:2], max(height, job.lowest_tcp())])
    touching = job.own() | {"table"}
    if job.goal is not None:
        touching |= job.scene.family(job.goal.id)
    path.line("place", down, allowed=touching, slow=True)
    away = down - over.approach * (theta["standoff"] + theta["grasp_depth"])
    let_go(path, down, away, grasp.opening, touching)
