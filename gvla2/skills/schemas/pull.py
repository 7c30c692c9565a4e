"""Pull a handle out of the face behind it, or draw an object that is held between others out by its free end."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Guard
from gvla2.skills.mechanisms import UP, Slide, Stuck, slide_for, stuck
from gvla2.skills.proposals import Grasp
from gvla2.skills.schemas.pick_place import TURNS, carry, goal_spots, let_go, over_spot, put_down, take

PLAY = 0.006
"""The open hand must be wider than the bar by this much, metres."""
ROOM = 0.004
"""Gap between a finger and the front behind it, metres."""
GIVE = 0.02
"""Tolerance while pulling, metres: the drawer guides the handle, and the arm yields."""
BACK = 0.03
"""Distance of the retreat, metres: the fingertips are then clear of the bar."""
LEANS = (0.0, 0.3, 0.6)
"""Downward tilts of a hand from the front, radians: near the table its body needs room."""
SIDE = 0.25
"""Further places to grasp along the handle, as a share of its length from the middle, either side."""
YAWS = (0.0, 0.35, -0.35)
"""Yaws of the hand in front of a level bar, radians: the fingers are above and below it."""
STOP = Guard(force=15.0)
"""The lift of a handle ends at its stop: its spring yields to a few newtons."""
LESS = 0.8
"""Share of the distance to pull if the arm cannot reach as far."""


def propose_pull(job: Job) -> list[Proposal] | Abstention:
    """From the front with the fingers above and below (or on both sides of) the bar, or from above over it."""
    slide = slide_for(job.theme, job.scene)
    if slide is None:
        return Abstention(
            "unknown_skill", f"The {job.theme.label} has no visible handle and is not stuck in anything."
        )
    handle = slide.handle
    axes, extents = handle.world_from_object[:3, :3], handle.extents
    along = axes[:, int(np.argmax(extents))]
    level = abs(along[2]) < 0.5
    across = UP if level else np.cross(UP, slide.out)
    width = 2 * handle.half_along(across)
    if width + PLAY > job.hand.max_width:
        return Abstention(
            "too_wide",
            f"The {handle.label} is {width * 1000:.0f} mm across; the hand opens {job.hand.max_width * 1000:.0f} mm.",
        )
    found, depth = list[Proposal](), job.theta["grasp_depth"]
    for shift in (0.0, SIDE, -SIDE):
        at = _grip_point(slide, width, depth) + shift * float(extents.max()) * along
        aside = f", {'left' if shift > 0 else 'right'} of its middle" if shift else ""
        for lean, yaw, less in product(LEANS, YAWS if level else YAWS[:1], (1.0, LESS)):
            if (yaw and lean > LEANS[1]) or (less < 1.0 and shift):
                continue
            tilt = Rotation.from_euler("z", yaw) * Rotation.from_rotvec(lean * np.cross(-slide.out, -UP))
            approach, closing = tilt.apply(-slide.out), tilt.apply(across)
            how = f"leaning {np.degrees(lean):.0f}°" + (
                f", from {np.degrees(yaw):.0f}° beside" if yaw else ""
            )
            preference = 0.8 - 0.4 * (lean + 0.5 * abs(yaw) + (1.0 - less)) - 0.1 * bool(shift)
            for sign in (1.0, -1.0):
                grasp = Grasp(how + aside, "handle", sign * closing, approach, at, 1.0, preference, depth)
                found.append(_pull(job, slide, grasp, less, reserve=bool(yaw) or less < 1.0))
        behind = (
            _behind(slide, at) - job.hand.finger_thickness - ROOM
        )  # room for the finger between bar and front
        if level and 2 * behind > width + PLAY:
            opening, preference = min(1.0, 2 * behind / job.hand.max_width), 0.6 - 0.1 * bool(shift)
            for sign in (1.0, -1.0):
                how, closing = "from above" + aside, sign * slide.out
                grasp = Grasp(how, "handle", closing, -UP, at, opening, preference, depth)
                found.append(_pull(job, slide, grasp))
    return found


def _behind(slide: Slide, at: FloatArray) -> float:
    """Distance from a point (3,) on the bar to the face behind it, metres."""
    objects = [t for t in (slide.front, slide.body) if t is not None]
    return float(at @ slide.out) - max(float(t.centre @ slide.out) + t.half_along(slide.out) for t in objects)


def _grip_point(slide: Slide, width: float, depth: float) -> FloatArray:
    """(3,) a point on the bar itself, assumed as deep as it is wide, not on the posts that hold it."""
    handle = slide.handle
    reach = handle.half_along(slide.out)
    return np.asarray(handle.centre + slide.out * (reach - min(depth, reach, max(0.5 * width, 0.003))))


def _pull(job: Job, slide: Slide, grasp: Grasp, less: float = 1.0, *, reserve: bool = False) -> Proposal:
    """Pull by a share ``less`` of the distance."""
    theta, near = job.theta, slide.parts
    distance = less * theta["pull_distance"]
    lifted = grasp.centre + UP * theta["unlatch_lift"]
    pulled = lifted + slide.out * distance
    path = take(job, grasp, frozenset({slide.handle.id}), "reach")
    path.carries, path.tolerance = slide.handle.id, GIVE
    if theta["unlatch_lift"] > 0.0:
        path.line("unlatch", lifted, allowed=near, slow=True, guard=STOP)
    path.line("pull", pulled, allowed=near, slow=True)
    let_go(path, pulled, pulled - grasp.approach * BACK, grasp.opening, near)
    how = f"pull the {slide.handle.label} by {distance * 100:.0f} cm, hand {grasp.description}"
    return Proposal(how, grasp.approaches, grasp.preference, path.trajectory(), reserve=reserve)


DRAW_PLAY = 0.006
DRAW_LEANS = (0.0, 0.3, 0.6)
"""Tilts of the hand away from what holds the object, radians, to keep the palm clear of it."""
LEAST_EXPOSED = 0.004


def propose_draw(job: Job) -> list[Proposal] | Abstention:
    """Each tilt of the hand and each way round, with each turn of the object at the goal."""
    held = stuck(job.theme, job.scene)
    if held is None:
        return Abstention("other", f"The {job.theme.label} is not stuck in anything.")
    across = np.cross(UP, held.way)
    width = 2 * held.theme.half_along(across)
    if width + DRAW_PLAY > job.hand.max_width:
        return Abstention(
            "too_wide",
            f"The {job.theme.label} is {width * 1000:.0f} mm wide; the hand opens {job.hand.max_width * 1000:.0f} mm.",
        )
    if held.exposed < 0.5 * job.hand.finger_breadth + LEAST_EXPOSED:
        return Abstention("other", f"Too little of the {job.theme.label} sticks out to grasp it.")
    snug = min(1.0, (width + 0.016) / job.hand.max_width)
    grasps = [
        _by_its_end(job, held, lean, sign * across, opening)
        for lean in DRAW_LEANS
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
        whole = replace(job, theme=held.theme)  # with its hidden part
        over = over_spot(whole, grasp, spot, turn)
        carry(path, over)
        put_down(whole, path, grasp, over, spot)
        how += f", put down {where}" + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    preference = grasp.preference - 0.1 * (turn != 0.0)
    return Proposal(how, grasp.approaches, preference, path.trajectory())
