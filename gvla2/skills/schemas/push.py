"""Push an object along the table with a straight stroke against a face, or press a button straight down.

Two contacts on one face push the object stably (Lynch and Mason, "Stable pushing", 1996): it sticks to the fingers,
even if the stroke is not square to the face, as long as the line through its middle along the stroke meets the face
between the contacts. So the hand is square to the face, not to the stroke, and centred on that line. If a single stroke
would be too oblique, there are two, along the normals of two faces.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import ROUND, SceneObject
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Guard
from gvla2.skills.mechanisms import UP
from gvla2.skills.parameters import defaults
from gvla2.skills.proposals import Path, horizontal, pointing
from gvla2.skills.schemas.pick_place import goal_spots, propose_place

EDGE = 0.006
"""The line of the push meets the face at least this far from its edge, metres: perceived boxes are inexact."""
LEAN = 0.5
"""How far the hand leans over a low object that stands close before something, radians."""
ASLANT = (0.0, 0.4, -0.4)
"""Turns of a hand that cradles a round object, from square to the push, radians."""
CLOSE = 0.012
"""Gap between a leaning hand's fingers and the object before the push, metres."""
LEAN_ROOM = 0.016
"""Gap between the object's top and the middle of a leaning palm, metres: half its depth, inclined."""
SHORT = 0.006
"""Shorter strokes are left out, metres: perception is hardly more accurate."""


@dataclass(frozen=True)
class _Stroke:
    """One straight push. ``begin`` and ``end`` (3,) are the object's centre; the hand's centre is ``behind`` (3,)
    of it, and the fingers close along ``closing`` (3,), opened to ``opening``. ``way`` (3,) is the unit direction. The
    hand leans that way by ``lean`` radians, over the object.
    """

    begin: FloatArray
    end: FloatArray
    way: FloatArray
    behind: FloatArray
    closing: FloatArray
    opening: float
    lean: float = 0.0


def propose_push(job: Job) -> list[Proposal] | Abstention:
    """One stroke on a face, square or slightly oblique, or two strokes on two faces."""
    goal = push_goal(job)
    shift = goal - job.theme.centre
    length = float(np.linalg.norm(shift))
    if length < SHORT:
        return Abstention(
            "other", f"The {job.theme.label} is there already, {length * 1000:.0f} mm from the goal."
        )
    way = shift / length
    goal = goal + job.theta["push_overshoot"] * way
    proposals: list[Proposal] = []
    low = job.theme.top - job.scene.table_height < job.hand.finger_length * np.cos(LEAN) - LEAN_ROOM
    for strokes, how, family, preference in _options(job, goal):
        if low and len(strokes) == 1:
            leaning = [replace(strokes[0], lean=LEAN)]
            proposals.append(_push(job, leaning, f"{how}, hand leaning over it", family, preference - 0.2))
        if blocked := _in_the_way(job, strokes):
            how, preference = f"{how}, but '{blocked.label}' is in the way", preference - 0.5
        proposals.append(_push(job, strokes, how, family, preference))
    return [*proposals, *_carried_instead(job)]


def _carried_instead(job: Job) -> list[Proposal]:
    """In reserve, for where no stroke is free: the object is carried there."""
    names = (
        "approach_tilt",
        "grasp_depth",
        "grasp_fraction",
        "transit_clearance",
        "place_height",
        "standoff",
    )
    theta = {**job.theta, **defaults("place", names, job.theme, job.hand, SkillOptions())}
    found = propose_place(replace(job, theta=theta))
    if isinstance(found, Abstention):
        return []
    return [replace(p, description=f"carried there: {p.description}", reserve=True) for p in found]


def push_goal(job: Job) -> FloatArray:
    """(3,) the intended final position of the theme's centre, at its present height."""
    theme, height = job.theme, job.theme.centre[2]
    touches = job.goal is not None and job.goal.shape != "region" and job.relation in ("on", "in", "to")
    if job.goal is None or job.target is not None or not touches:
        spots = goal_spots(job)
        nearest = min(spots, key=lambda s: float(np.linalg.norm(s[0][:2] - theme.centre[:2])))
        return np.array([*nearest[0][:2], height])
    # To a solid object: until they touch.
    level = (job.goal.centre - theme.centre) * [1.0, 1.0, 0.0]
    way = level / max(float(np.linalg.norm(level)), 1e-9)
    touching = job.goal.half_along(way)
    touching += theme.half_along(way)
    return np.array([*(job.goal.centre - way * (touching + 0.003))[:2], height])


def _options(job: Job, goal: FloatArray) -> Iterator[tuple[list[_Stroke], str, str, float]]:
    """Strokes, description, family and preference of each way to push."""
    theme = job.theme
    shift = goal - theme.centre
    way = shift / np.linalg.norm(shift)
    if theme.shape in ROUND:
        radius = 0.5 * float(theme.extents[:2].max())
        for aslant in ASLANT:
            text = "push between two fingers" + (f", hand turned {np.degrees(aslant):.0f}°" if aslant else "")
            for stroke in _round(theme.centre, goal, way, radius, aslant, job):
                yield [stroke], text, "straight", 0.9 - 0.3 * abs(aslant)
        return
    normals = [n for n in theme.upright_faces() if n @ way > 1e-3]
    for normal in normals:
        depth = theme.half_along(normal)
        across = np.array([-normal[1], normal[0], 0.0])
        half_face = theme.half_along(across)
        oblique = float(np.arctan2(abs(way @ across), way @ normal))
        if depth * np.tan(oblique) <= half_face - EDGE:
            for sign in (1.0, -1.0):
                stroke = _face(job, theme.centre, goal, normal, sign)
                text = f"push on a face, {np.degrees(oblique):.0f}° from square to it"
                text += ", hand turned round" if sign < 0 else ""
                yield [stroke], text, "straight", 0.9 - 0.4 * oblique
    if len(normals) == 2:
        for first, second in (normals, normals[::-1]):
            parts = np.linalg.solve(np.stack([first[:2], second[:2]], axis=1), shift[:2])
            if parts.min() < SHORT:
                continue
            corner = theme.centre + parts[0] * first
            for one, other in product((1.0, -1.0), repeat=2):
                strokes = [
                    _face(job, theme.centre, corner, first, one),
                    _face(job, corner, goal, second, other),
                ]
                text = f"push {parts[0] * 100:.0f} cm square to one face, then {parts[1] * 100:.0f} cm to the next"
                yield strokes, text, "two_strokes", 0.6 + 0.01 * (parts[0] > parts[1])


def _face(job: Job, begin: FloatArray, end: FloatArray, normal: FloatArray, sign: float) -> _Stroke:
    """A push on the face opposite to ``normal``, with the fingers as far apart as fits, centred on the push's line."""
    theme, hand = job.theme, job.hand
    way = (end - begin) / np.linalg.norm(end - begin)
    across = np.array([-normal[1], normal[0], 0.0])
    depth = theme.half_along(normal)
    half_face = theme.half_along(across)
    # Where the line of the push through the middle meets the rear face.
    aside = -depth * float(way @ across) / float(way @ normal)
    spread = 2 * (half_face - abs(aside)) - 2 * hand.finger_thickness
    opening = float(np.clip(spread / hand.max_width, 0.0, 1.0))
    behind = aside * across - (depth + _contact_depth(job)) * normal
    return _Stroke(begin, end, way, behind, sign * across, opening)


def _contact_depth(job: Job) -> float:
    """Distance from the hand's middle to what touches first: the fingers, or the palm if the object is that tall."""
    palm = job.theme.top - job.scene.table_height > job.theta["push_height"] + job.hand.finger_length
    return 0.5 * (job.hand.palm_depth if palm else job.hand.finger_breadth)


def _round(
    begin: FloatArray, end: FloatArray, way: FloatArray, radius: float, aslant: float, job: Job
) -> Iterator[_Stroke]:
    """Two fingers behind a round object, opened to its radius: they cradle it, also if the hand is turned by ``aslant``
    radians from square to the push, as long as the push's line is between them.
    """
    hand = job.hand
    opening = float(np.clip(radius / hand.max_width, 0.0, 1.0))
    inner = 0.5 * opening * hand.max_width
    gap = np.sqrt(max(0.0, radius**2 - inner**2))  # from the middle to the fingers' inner edges
    normal = Rotation.from_euler("z", aslant).apply(way)
    across = np.array([-normal[1], normal[0], 0.0])
    behind = -(gap + _contact_depth(job)) * normal
    for sign in (1.0, -1.0):
        yield _Stroke(begin, end, way, behind, sign * across, opening)


def _push(job: Job, strokes: list[_Stroke], how: str, family: str, preference: float) -> Proposal:
    """Go behind the object, down, push, back off and up; likewise for a second stroke, equally open."""
    theta, theme = job.theta, frozenset({job.theme.id})
    tcp = max(job.scene.table_height + theta["push_height"] + job.hand.tip_beyond_tcp, job.lowest_tcp())
    above = min(job.theme.top + 0.02 + job.hand.tip_beyond_tcp, job.ceiling())
    path = Path(theta["speed"], theta["contact_speed"])
    touched: frozenset[str] = frozenset()
    opening = min(stroke.opening for stroke in strokes)
    for k, stroke in enumerate(strokes):
        part = f" {k + 1}" if len(strokes) > 1 else ""
        square = np.array([stroke.closing[1], -stroke.closing[0], 0.0])
        square = square if square @ stroke.way > 0.0 else -square
        down = -np.cos(stroke.lean) * UP - np.sin(stroke.lean) * square
        path.orientation = pointing(stroke.closing, down)
        standoff = CLOSE if stroke.lean else theta["standoff"]  # a leaning palm is not behind the fingers
        start, end = (
            np.array([*(c + stroke.behind)[:2], tcp])
            for c in (stroke.begin - standoff * stroke.way, stroke.end)
        )
        over = np.array([*start[:2], above])
        if k == 0:
            path.go("approach", over, gripper=opening)
        else:  # straight over the object, which is no longer where it was seen
            path.line(f"approach{part}", over, gripper=opening, allowed=touched)
        path.line(f"lower{part}", start, allowed=touched)
        touched = theme
        path.line(f"push{part}", end, allowed=touched, slow=True)
        off = end - standoff * stroke.way
        path.line(f"back off{part}", off, allowed=touched)
        path.line(f"retreat{part}", np.array([*off[:2], above]), allowed=touched)
    return Proposal(how, ("approach:top", f"approach:{family}"), preference, path.trajectory())


def _in_the_way(job: Job, strokes: list[_Stroke]) -> SceneObject | None:
    """The first object that the pushed one would hit."""
    theme = job.theme
    half = 0.5 * theme.extents[:2]
    ignored = frozenset({theme.id} | ({job.goal.id} if job.goal is not None else set()))
    axes = theme.world_from_object[:2, :2]
    for other in job.scene.obstacles(ignored):
        corners = other.corners()
        outline = np.vstack([corners, other.centre, other.points]) if len(other.points) else corners
        for stroke in strokes:
            steps = max(2, int(np.linalg.norm(stroke.end - stroke.begin) / 0.01))
            for centre in np.linspace(stroke.begin, stroke.end, steps):
                if (np.abs((outline[:, :2] - centre[:2]) @ axes) < half + 0.005).all(axis=1).any():
                    return other
    return None


YAWS = 8

STOP = Guard(force=25.0)
"""A press ends at a button's stop: buttons yield to a few newtons, their stops do not."""


def propose_press(job: Job) -> list[Proposal]:
    """One proposal for each yaw of the closed hand, with and without contact with what the button stands on."""
    proposals = [_press(job, np.pi * k / YAWS, False) for k in range(2 * YAWS)]
    if job.theme.parent:
        proposals += [_press(job, np.pi * k / YAWS, True) for k in range(2 * YAWS)]
    return proposals


def _press(job: Job, yaw: float, touching: bool) -> Proposal:
    theta, theme = job.theta, job.theme
    contact = theme.top + job.hand.tip_beyond_tcp
    above = np.array([*theme.centre[:2], contact + theta["standoff"]])
    down = np.array([*theme.centre[:2], max(contact - theta["press_depth"], job.lowest_tcp())])
    allowed = frozenset({theme.id, theme.parent} if touching else {theme.id})
    path = Path(theta["speed"], theta["contact_speed"], pointing(horizontal(yaw)), gripper=0.0)
    path.go("approach", above, allowed=frozenset({theme.parent}) if touching else frozenset())
    path.line("press", down, allowed=allowed, slow=True, guard=STOP)
    path.line("stay", down, allowed=allowed, slow=True, guard=STOP, dwell=theta["press_seconds"])
    path.line("retreat", above, allowed=allowed)
    how = f"press from above, yaw {np.degrees(yaw):.0f}°" + (", its base may be touched" if touching else "")
    return Proposal(how, ("approach:top",), 0.4 if touching else 0.8, path.trajectory())
