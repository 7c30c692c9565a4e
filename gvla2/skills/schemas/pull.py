"""Pull a handle out of the face behind it, push a drawer shut, or draw an object that is held between others out by its
free end.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Guard, Trajectory
from gvla2.skills.mechanisms import UP, Slide, Stuck, slide_for, stuck
from gvla2.skills.proposals import Grasp, Path, pointing
from gvla2.skills.schemas.pick_place import TURNS, carry, goal_spots, let_go, over_spot, put_down, take

PLAY = 0.006
"""The open hand must be wider than the bar by this much, metres."""
ROOM = 0.004
"""Gap between a finger and the front behind it, metres."""
GIVE = 0.02
"""Tolerance while pulling, metres: the drawer guides the handle, and the arm yields."""
BACK = 0.03
"""Distance of the retreat, metres: the fingertips are then clear of the bar."""
LEANS = (0.0, 0.2, 0.4, 0.6)
"""Downward tilts of a hand from the front, radians: near the table its body needs room."""
HOOKS = (0.4, 0.3, 0.2, 0.5, 0.7)
"""Downward tilts of a hand whose fingers hook behind a bar, radians."""
OVER, FRONT_GAP = 0.0025, 0.001
"""Gaps of hooking fingers above the bar on their way in, and to the front behind it, metres."""
PRESSED = 0.0025
"""How far hooking fingers press onto the bar, metres: its height is only known to this."""
LAG = 0.004
"""A motion that another body yields to goes on by this much, metres."""
AT_END = 0.005
"""A joint this near to its end has reached it, metres."""
SIDE = 0.25
"""Further places to grasp along the handle, as a share of its length from the middle, either side."""
YAWS = (0.0, 0.35, -0.35)
"""Yaws of the hand in front of a level bar, radians: the fingers are above and below it."""
STOP = Guard(force=15.0)
"""The lift of a handle ends at its stop: its spring yields to a few newtons."""
LESS = 0.8
"""Share of the distance to pull if the arm cannot reach as far."""


def propose_pull(job: Job) -> list[Proposal] | Abstention:
    """From the front with the fingers above and below (or on both sides of) the bar, from above over it, or hooked
    behind a level bar.
    """
    slide = slide_for(job.theme, job.scene)
    if slide is None:
        return Abstention(
            "unknown_skill", f"The {job.theme.label} has no visible handle and is not stuck in anything."
        )
    if slide.handle is slide.front:
        return Abstention("unknown_skill", f"The {slide.front.label} has no handle to pull.")
    if slide.joint is not None and slide.joint.reach - slide.joint.position < AT_END:
        return Abstention("other", f"The {slide.front.label} is open already.")
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
    # Wide open if there is room; next to other handles no wider than needed.
    openings = (1.0, min(1.0, (width + 2 * job.grasp.snug) / job.hand.max_width))
    for shift in (0.0, SIDE, -SIDE):
        at = _grip_point(slide, width, depth) + shift * float(extents.max()) * along
        aside = f", {'left' if shift > 0 else 'right'} of its middle" if shift else ""
        for lean, yaw, less in product(LEANS, YAWS if level else YAWS[:1], (1.0, LESS)):
            if (yaw and lean > LEANS[2]) or (less < 1.0 and shift):
                continue
            tilt = Rotation.from_euler("z", yaw) * Rotation.from_rotvec(lean * np.cross(-slide.out, -UP))
            approach, closing = tilt.apply(-slide.out), tilt.apply(across)
            how = f"leaning {np.degrees(lean):.0f}°" + (
                f", from {np.degrees(yaw):.0f}° beside" if yaw else ""
            )
            preference = 0.8 - 0.4 * (lean + 0.5 * abs(yaw) + (1.0 - less)) - 0.1 * bool(shift)
            for sign, opening in product((1.0, -1.0), openings):
                better = preference - 0.05 * (opening < 1.0)
                grasp = Grasp(how + aside, "handle", sign * closing, approach, at, opening, better, depth)
                found.append(_pull(job, slide, grasp, less, reserve=bool(yaw) or less < 1.0))
        room = float(at @ slide.out) - slide.face  # behind the bar, to its middle
        behind = room - job.hand.finger_thickness - ROOM
        if level and 2 * behind > width + PLAY:
            opening, preference = min(1.0, 2 * behind / job.hand.max_width), 0.6 - 0.1 * bool(shift)
            for sign in (1.0, -1.0):
                how, closing = "from above" + aside, sign * slide.out
                grasp = Grasp(how, "handle", closing, -UP, at, opening, preference, depth)
                found.append(_pull(job, slide, grasp))
        if level and not shift:
            found += [
                _hook(job, slide, at, width, sign * along, lean) for lean in HOOKS for sign in (1.0, -1.0)
            ]
    return found


def _grip_point(slide: Slide, width: float, depth: float) -> FloatArray:
    """(3,) a point on the bar itself, assumed as deep as it is wide, not on the posts that hold it."""
    handle = slide.handle
    reach = handle.half_along(slide.out)
    return np.asarray(handle.centre + slide.out * (reach - min(depth, reach, max(0.5 * width, 0.003))))


def _distance(job: Job, slide: Slide, less: float = 1.0) -> float:
    """How far to pull, metres: nearly as far as the joint goes, where it is known; at its stop the bar would slip."""
    far = np.inf if slide.joint is None else slide.joint.reach - slide.joint.position - LAG
    return float(less * min(job.theta["pull_distance"], far))


def _pull(job: Job, slide: Slide, grasp: Grasp, less: float = 1.0, *, reserve: bool = False) -> Proposal:
    """Pull by a share ``less`` of the distance."""
    distance = _distance(job, slide, less)

    def way() -> Trajectory:
        theta, near = job.theta, slide.parts
        lifted = grasp.centre + UP * theta["unlatch_lift"]
        pulled = lifted + slide.out * distance
        path = take(job, grasp, frozenset({slide.handle.id}), "reach")
        path.carries, path.tolerance = slide.handle.id, GIVE
        if theta["unlatch_lift"] > 0.0:
            path.line("unlatch", lifted, allowed=near, slow=True, guard=STOP)
        path.line("pull", pulled, allowed=near, slow=True)
        let_go(path, pulled, pulled - grasp.approach * BACK, grasp.opening, near)
        return path.trajectory()

    how = f"pull the {slide.handle.label} by {distance * 100:.0f} cm, hand {grasp.description}"
    return Proposal(how, grasp.approaches, grasp.preference, way, reserve=reserve)


def _hook(job: Job, slide: Slide, at: FloatArray, width: float, closing: FloatArray, lean: float) -> Proposal:
    """Closed fingers, leaning by ``lean`` from level, reach over the bar into the gap behind it: low handles leave no
    room for a hand that is broad along its closing direction.
    """
    theta, hand, distance = job.theta, job.hand, _distance(job, slide)
    near = frozenset({slide.handle.id, slide.front.id})

    def way() -> Trajectory:
        into = -np.cos(lean) * slide.out - np.sin(lean) * UP
        over = np.cos(lean) * UP - np.sin(lean) * slide.out  # from the bar to the middle of the fingers
        # From the bar's upper rear edge, the tips reach on until their other side is near the front.
        outer = slide.handle.centre @ slide.out + slide.handle.half_along(slide.out)
        edge = at + (0.5 * width) * UP + (outer - width - at @ slide.out) * slide.out
        gap = float(edge @ slide.out) - slide.face
        deep = (gap - FRONT_GAP - (hand.finger_breadth + OVER) * np.sin(lean)) / np.cos(lean)
        beyond = min(deep, width) - hand.tip_beyond_tcp
        behind = edge + beyond * into + (0.5 * hand.finger_breadth + OVER) * over
        path = Path(theta["speed"], theta["contact_speed"], pointing(closing, into), 0.0, tolerance=GIVE)
        path.go("approach", behind - into * (theta["standoff"] + hand.tip_beyond_tcp + max(0.0, beyond)))
        path.line("reach", behind, allowed=near, slow=True)
        hooked = behind - UP * (OVER + PRESSED) / np.cos(lean)
        path.line("hook", hooked, allowed=near, slow=True)
        path.line("pull", hooked + slide.out * (distance + LAG), allowed=near, slow=True)
        path.line("unhook", path.end + UP * (OVER + PRESSED) - slide.out * LAG, allowed=near)
        path.line("retreat", path.end - into * BACK, allowed=near)
        return path.trajectory()

    how = f"pull the {slide.handle.label} by {distance * 100:.0f} cm with the fingers hooked behind it"
    how += f", leaning {np.degrees(lean):.0f}°"
    return Proposal(how, ("approach:side", "approach:hook"), 0.45 - 0.1 * abs(lean - HOOKS[0]), way)


def propose_shut(job: Job, slide: Slide) -> list[Proposal] | Abstention:
    """Push a drawer shut, closed fingers level against the middle of its front or its handle."""
    joint = slide.joint
    if joint is None:
        return Abstention("unknown_skill", f"How far the {slide.front.label} is open is not known.")
    if joint.position < AT_END:
        return Abstention("other", f"The {slide.front.label} is closed already.")
    hand, theta, touched = job.hand, job.theta, slide.handle
    near = frozenset({slide.handle.id, slide.front.id})
    aside = np.cross(UP, slide.out)

    def shut(lean: float, sign: float) -> Proposal:
        def way() -> Trajectory:
            into = -np.cos(lean) * slide.out - np.sin(lean) * UP
            contact = touched.centre + touched.half_along(slide.out) * slide.out - hand.tip_beyond_tcp * into
            path = Path(theta["speed"], theta["contact_speed"], pointing(sign * aside, into), 0.0)
            path.tolerance = GIVE
            path.go("approach", contact - into * theta["standoff"])
            path.line("touch", contact, allowed=near, slow=True)
            path.line("push", contact - slide.out * (joint.position + LAG), allowed=near, slow=True)
            path.line("retreat", path.end - into * theta["standoff"], allowed=near)
            return path.trajectory()

        how = f"push the {slide.front.label} shut, hand leaning {np.degrees(lean):.0f}°"
        return Proposal(how, ("approach:side",), 0.8 - 0.3 * lean, way)

    return [shut(lean, sign) for lean in LEANS for sign in (1.0, -1.0)]


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
