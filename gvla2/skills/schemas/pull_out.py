"""Pull out: grasp an object that is held between others by its free end, draw it out level, and put it down."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.skills.mechanisms import UP
from gvla2.skills.proposals import Job, Path, Proposal, pointing
from gvla2.skills.schemas.pick import Grasp, let_go, take
from gvla2.skills.schemas.place import TURNS, goal_spots
from gvla2.skills.stuck import Stuck, stuck

PLAY = 0.006
LEANS = (0.0, 0.3, 0.6)
"""Tilts of the hand away from what holds the object, radians, to keep the palm clear of it."""
ROOM = 0.004


def propose_draw(job: Job) -> list[Proposal] | Abstention:
    """Each tilt of the hand and each way round, with each turn of the object at the goal."""
    held = stuck(job.theme, job.scene)
    if held is None:
        return Abstention("other", f"The {job.theme.label} is not stuck in anything.")
    across = np.cross(UP, held.way)
    width = 2 * held.theme.half_along(across)
    if width + PLAY > job.hand.max_width:
        return Abstention(
            "too_wide",
            f"The {job.theme.label} is {width * 1000:.0f} mm wide; the hand opens {job.hand.max_width * 1000:.0f} mm.",
        )
    if held.exposed < 0.5 * job.hand.finger_breadth + ROOM:
        return Abstention("other", f"Too little of the {job.theme.label} sticks out to grasp it.")
    snug = min(1.0, (width + 0.016) / job.hand.max_width)
    grasps = [
        _by_its_end(job, held, lean, sign * across, opening)
        for lean in LEANS
        for sign in (1.0, -1.0)
        for opening in dict.fromkeys((snug, 1.0))
    ]
    if job.goal is None and job.target is None:
        return [_draw(job, held, grasp) for grasp in grasps]
    return [
        _draw(job, held, grasp, spot, where, turn)
        for spot, where in goal_spots(job)
        for turn in TURNS
        for grasp in grasps
    ]


def _by_its_end(job: Job, held: Stuck, lean: float, closing: FloatArray, opening: float) -> Grasp:
    inside = min(job.theta["end_distance"], 0.5 * held.exposed)
    centre, back = held.end - held.way * inside, job.theta["grasp_depth"]
    centre[2] = held.theme.top - back
    approach = -UP * np.cos(lean) - held.way * np.sin(lean)
    how = "drawn out by its free end, hand " + (f"leaning {np.degrees(lean):.0f}°" if lean else "from above")
    preference = 0.8 - 0.4 * lean - 0.05 * (opening == 1.0)
    return Grasp(how, "end", closing, approach, centre, opening, preference, back)


def _draw(
    job: Job, held: Stuck, grasp: Grasp, spot: FloatArray | None = None, where: str = "", turn: float = 0.0
) -> Proposal:
    own = frozenset({held.theme.id})
    path = take(job, grasp, own, "reach")
    drawn = grasp.centre + held.way * (held.hidden + job.theta["pull_distance"])
    path.line("pull", drawn, allowed=own | held.holders | {"table"}, slow=True)
    how = grasp.description
    if spot is not None:
        _put(job, held, path, grasp, drawn, spot, turn)
        how += f", put down {where}" + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    preference = grasp.preference - 0.1 * (turn != 0.0)
    return Proposal(how, grasp.approaches, preference, path.trajectory())


def _put(
    job: Job, held: Stuck, path: Path, grasp: Grasp, drawn: FloatArray, spot: FloatArray, turn: float
) -> None:
    """Carry it over the goal, lower, let go, retreat straight up."""
    theta, theme, grip = job.theta, held.theme, grasp.centre
    rotation = Rotation.from_euler("z", turn)
    offset = rotation.apply(grip - theme.centre)
    hangs = grip[2] - theme.bottom
    path.orientation = pointing(rotation.apply(grasp.closing), rotation.apply(grasp.approach))
    down = np.array([*(spot + offset)[:2], max(spot[2] + theta["place_height"] + hangs, job.lowest_tcp())])
    over = np.array([*down[:2], max(drawn[2], down[2] + theta["transit_clearance"])])
    touching = frozenset({theme.id, "table"} | ({job.goal.id} if job.goal is not None else set()))
    path.go("transit", over, allowed=touching)
    path.line("place", down, allowed=touching, slow=True)
    let_go(path, down, down + UP * (theta["standoff"] + theta["grasp_depth"]), grasp.opening, touching)
