"""Place: pick, carry over everything, lower, let go, back up."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2_plugins.skill.proposals import Job, Path, Proposal, pointing
from gvla2_plugins.skill.schemas.pick import Grasp, grasps, take

TURNS = (0.0, 0.5 * np.pi, -0.5 * np.pi)
"""The object may be put down turned by a quarter: what is out of the wrist's reach one way is in reach the other."""
SIDE_GAP = 0.03
"""Gap between things put beside one another, metres: room for a finger."""


def propose_place(job: Job) -> list[Proposal] | Abstention:
    """Each grasp with each spot and each turn of the object at the goal."""
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    turns = TURNS[:1] if job.theme.shape in ("cylinder", "disc", "sphere") else TURNS
    return [
        _place(job, grasp, spot, name, turn)
        for grasp in found
        for spot, name in goal_spots(job)
        for turn in turns
    ]


def goal_spots(job: Job) -> list[tuple[FloatArray, str]]:
    """Where the theme's centre may go (x, y, and the support's height z), with a word for each, best first."""
    table = job.scene.table_height
    if job.target is not None:
        return [(np.array([*job.target, table]), "there")]
    if job.goal is None:
        raise ValueError("A goal or a target is needed to place something.")
    goal, theme = job.goal, job.theme
    if job.relation in ("on", "in", "to"):
        support = table if goal.shape == "region" else goal.top
        return [(np.array([*goal.centre[:2], support]), "onto it")]
    sides = {
        "left_of": ("left",), "right_of": ("right",), "behind": ("far",), "front_of": ("near",),
    }.get(job.relation, ("left", "right", "near", "far"))  # fmt: skip
    ways = {"left": (0.0, 1.0), "right": (0.0, -1.0), "far": (1.0, 0.0), "near": (-1.0, 0.0)}
    spots = []
    for side in sides:
        way = np.array([*ways[side], 0.0])
        # Half the diagonal of the theme: it may come turned.
        reach = support_along(goal.world_from_object, goal.extents, way) + 0.5 * np.linalg.norm(
            theme.extents[:2]
        )
        spot = goal.centre + way * (reach + SIDE_GAP)
        spots.append((np.array([*spot[:2], table]), f"at its {side} side"))
    return spots


def support_along(world_from_object: FloatArray, extents: FloatArray, way: FloatArray) -> float:
    """How far an oriented box reaches from its centre along a unit vector (3,), metres."""
    return float(np.abs(way @ world_from_object[:3, :3]) @ (0.5 * extents))


def _place(job: Job, grasp: Grasp, spot: FloatArray, where: str, turn: float) -> Proposal:
    theta, theme, goal = job.theta, job.theme, job.goal
    path = take(job, grasp)
    hangs = grasp.centre[2] - theme.bottom  # from the tool down to the object's underside
    highest = max((o.top for o in job.scene.obstacles(frozenset({theme.id}))), default=job.scene.table_height)
    height = min(max(highest, theme.bottom) + theta["transit_clearance"] + hangs, job.ceiling())
    touching = frozenset({theme.id, "table"})
    path.line("lift", np.array([*grasp.centre[:2], height]), allowed=touching)
    rotation = Rotation.from_euler("z", turn)
    offset = rotation.apply(grasp.centre - theme.centre)
    path.orientation = pointing(rotation.apply(grasp.closing), rotation.apply(grasp.approach))
    over = np.array([*(spot + offset)[:2], height])
    down = np.array([*over[:2], max(spot[2] + theta["place_height"] + hangs, job.lowest_tcp())])
    path.go("transit", over)
    touching |= {goal.id} if goal is not None else frozenset()
    path.line("place", down, allowed=touching, slow=True)
    _let_go(path, down, grasp, touching)
    path.line(
        "retreat",
        down - rotation.apply(grasp.approach) * (theta["standoff"] + theta["grasp_depth"]),
        allowed=touching,
    )
    how = f"{grasp.description}; put down {where}" + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    preference = grasp.preference - 0.05 * (turn != 0.0)
    return Proposal(how, grasp.approaches, preference, path.trajectory())


def _let_go(path: Path, at: FloatArray, grasp: Grasp, touching: frozenset[str]) -> None:
    path.line("release", at, gripper=grasp.opening, allowed=touching, slow=True)
    path.carries = ""
