"""Pull out: a thing that is held between others is taken by its free end, drawn out level, and put down."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.skills.mechanisms import UP
from gvla2.skills.proposals import Job, Path, Proposal, pointing
from gvla2.skills.schemas.place import TURNS, goal_spots
from gvla2.skills.stuck import Stuck, stuck

PLAY = 0.006
LEANS = (0.0, 0.3, 0.6)
"""How far the hand may lean away from what holds the thing, radians: its palm then stays clear of it."""
ROOM = 0.004


def propose_draw(job: Job) -> list[Proposal] | Abstention:
    """Each lean of the hand and each way round, with each turn of the thing at the goal."""
    held = stuck(job.theme, job.scene)
    if held is None:
        return Abstention("other", f"The {job.theme.label} is stuck in nothing.")
    across = np.cross(UP, held.way)
    width = float(np.abs(across @ held.theme.world_from_object[:3, :3]) @ held.theme.extents)
    if width + PLAY > job.hand.max_width:
        return Abstention(
            "too_wide",
            f"The {job.theme.label} is {width * 1000:.0f} mm wide; the hand opens {job.hand.max_width * 1000:.0f} mm.",
        )
    if held.exposed < 0.5 * job.hand.finger_breadth + ROOM:
        return Abstention("other", f"Too little of the {job.theme.label} sticks out to take hold of it.")
    has_goal = job.goal is not None or job.target is not None
    spots = goal_spots(job) if has_goal else [(np.zeros(3), "")]
    snug = min(1.0, (width + 0.016) / job.hand.max_width)
    return [
        _draw(job, held, lean, sign * across, opening, spot if has_goal else None, where, turn)
        for spot, where in spots
        for turn in (TURNS if has_goal else TURNS[:1])
        for lean in LEANS
        for sign in (1.0, -1.0)
        for opening in dict.fromkeys((snug, 1.0))
    ]


def _draw(
    job: Job,
    held: Stuck,
    lean: float,
    closing: FloatArray,
    opening: float,
    spot: FloatArray | None,
    where: str,
    turn: float,
) -> Proposal:
    theta, theme = job.theta, held.theme
    approach = -UP * np.cos(lean) - held.way * np.sin(lean)
    inside = min(theta["end_distance"], 0.5 * held.exposed)
    grip = held.end - held.way * inside
    grip[2] = theme.top - theta["grasp_depth"]
    path = Path(theta["speed"], theta["contact_speed"], pointing(closing, approach))
    own = frozenset({theme.id})
    path.go("approach", grip - approach * (theta["standoff"] + theta["grasp_depth"]), gripper=opening)
    path.line("reach", grip, allowed=own, slow=True)
    path.line("close", grip, gripper=0.0, allowed=own, slow=True)
    path.carries = theme.id
    drawn = grip + held.way * (held.hidden + theta["pull_distance"])
    path.line("pull", drawn, allowed=own | held.holders | {"table"}, slow=True)
    how = "drawn out by its free end, hand " + (f"leaning {np.degrees(lean):.0f}°" if lean else "from above")
    if spot is not None:
        approach = _put(job, held, path, grip, drawn, approach, closing, opening, spot, turn)
        how += f", put down {where}" + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    preference = 0.8 - 0.4 * lean - 0.1 * (turn != 0.0) - 0.05 * (opening == 1.0)
    return Proposal(how, ("approach:top", "approach:end"), preference, path.trajectory())


def _put(
    job: Job,
    held: Stuck,
    path: Path,
    grip: FloatArray,
    drawn: FloatArray,
    approach: FloatArray,
    closing: FloatArray,
    opening: float,
    spot: FloatArray,
    turn: float,
) -> FloatArray:
    """Carry it over the goal, lower, let go, back off; the hand's direction (3,) there."""
    theta, theme = job.theta, held.theme
    rotation = Rotation.from_euler("z", turn)
    offset = rotation.apply(grip - theme.centre)
    hangs = grip[2] - theme.bottom
    approach = rotation.apply(approach)
    path.orientation = pointing(rotation.apply(closing), approach)
    down = np.array([*(spot + offset)[:2], max(spot[2] + theta["place_height"] + hangs, job.lowest_tcp())])
    over = np.array([*down[:2], max(drawn[2], down[2] + theta["transit_clearance"])])
    touching = frozenset({theme.id, "table"}) | (
        frozenset({job.goal.id}) if job.goal is not None else frozenset()
    )
    path.go("transit", over, allowed=touching)
    path.line("place", down, allowed=touching, slow=True)
    path.line("release", down, gripper=opening, allowed=touching, slow=True)
    path.carries = ""
    path.line("retreat", down + UP * (theta["standoff"] + theta["grasp_depth"]), allowed=touching)
    return np.asarray(approach)
