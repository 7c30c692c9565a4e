"""Lifting: from the points of a hand's path to a full trajectory that a robot can execute.

The paper's planner answers tau = {(x, y, z, g)}. The rest is inferred from the scene: how the hand is oriented and
centred (from the holds of the object where it closes), which motions are straight, what is carried, what may be
touched, and the objects' roles. Points are rough: the hand takes the nearest grasp that fits, at the point's depth as
far as the fingers reach, and an object released at a goal is put down instead of dropped. Where the path leads, and in
which order, is up to the planner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import PlanningError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.effects import Bound, apply_effects, sides_of
from gvla2.planning.part_hierarchy import assembled, button_of, joined
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.skill import Job, Proposal
from gvla2.skills.carry_out import answer
from gvla2.skills.grasps import grasps
from gvla2.skills.grounding import whole_meant
from gvla2.skills.mechanisms import stuck
from gvla2.skills.parameters import limited
from gvla2.skills.proposals import Grasp, Path
from gvla2.skills.schemas.pick_place import (
    TURNS,
    aligning_turns,
    carry,
    draw_out,
    fits_over,
    lower_over,
    over_spot,
    put_down,
    take,
)
from gvla2.skills.schemas.push import propose_press, propose_push
from gvla2.skills.table import STANDARD

CLOSED = 0.5
"""A hand opened by a smaller share counts as closed."""
MOST_POINTS = 16
SHALLOWEST = 0.006
"""Least depth of a grasp below the top, metres."""
NEAR = 0.04
"""A point this close to an object's box is at that object, metres."""
LEVEL = 0.05
"""A closed hand pushes if it moves sideways by more and vertically by less than this, metres."""


@dataclass(frozen=True)
class PathPoint:
    """One point of the hand's path: ``xyz`` of the tool, world metres, and the ``gripper``'s opening in [0, 1].

    ``at`` is the id of the object that the point was written for, or "".
    """

    xyz: tuple[float, float, float]
    gripper: float
    at: str = ""

    @property
    def closed(self) -> bool:
        """Whether the hand is closed from here on."""
        return self.gripper < CLOSED

    @property
    def array(self) -> FloatArray:
        """(3,) world metres."""
        return np.asarray(self.xyz, dtype=np.float64)


def lift(points: Sequence[PathPoint], request: PlanRequest, options: SkillOptions | None = None) -> Plan:
    """The plan along ``points`` for the request's scene and arm, with the first orientation of the hand that passes the
    checks; a typed abstention if none does.

    Raises :class:`PlanningError` for no points, too many, or a hand that closes or pushes where there is nothing.
    """
    options = options or SkillOptions()
    if not 1 <= len(points) <= MOST_POINTS:
        raise PlanningError(f"The path has {len(points)} points; it needs 1 to {MOST_POINTS}.")
    take = _take(points, request.scene)
    if take is None:
        return _touch(points, request, options)
    obj = _object_at(points[take], request.scene)
    if obj is None:
        raise PlanningError(
            f"The hand closes at {in_millimetres(points[take], request.scene)} where there is nothing to hold."
        )
    theme, scene = joined(whole_meant(obj, request.scene), request.scene)
    theme, request = assembled(theme, scene), replace(request, scene=scene)
    opened = next((k for k in range(take + 1, len(points)) if not points[k].closed), None)
    goal = None
    if opened is not None:
        own = scene.family(theme.id)
        goal = _goal_at(_rest(points, take, opened, theme), scene, own)
        done = own if goal is None else own | {goal.id}
        for point in points[opened + 1 :]:
            if point.closed and (second := _object_at(point, scene)) is not None and second.id not in done:
                raise PlanningError(
                    f"The hand closes again, at {in_millimetres(point, scene)}: a path handles one object only."
                )
    name = "pick" if opened is None else "insert" if goal is not None and fits_over(theme, goal) else "place"
    depth = {"grasp_depth": max(SHALLOWEST, theme.top - points[take].xyz[2])}
    return _followed(
        name, theme, goal, depth, lambda job: carried(job, points, take, opened), request, options
    )


def in_millimetres(point: PathPoint, scene: Scene) -> str:
    """A point for messages: millimetres, z above the table."""
    x, y, z = (1e3 * v for v in point.xyz)
    return f"({x:.0f}, {y:.0f}, {z - 1e3 * scene.table_height:.0f}) mm"


def _touch(points: Sequence[PathPoint], request: PlanRequest, options: SkillOptions) -> Plan:
    """The plan of a path without a grasp: the closed hand pushes or presses."""
    scene, hand = request.scene, request.arm.hand
    level = [(a, b) for a, b in pairwise(points) if abs(b.xyz[2] - a.xyz[2]) < LEVEL]
    a, b = max(
        level, key=lambda move: math.dist(move[0].xyz[:2], move[1].xyz[:2]), default=(points[0], points[0])
    )
    shift = (b.array - a.array) * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(shift))
    struck = _struck(a, b, scene) if length > LEVEL else None
    if struck is not None:
        reach = struck.half_along(shift / length) + 0.5 * hand.finger_breadth
        target = (b.array + reach * shift / length)[:2]  # the hand stops at the path's end
        goal = _goal_at(b, scene, frozenset({struck.id}))
        return _followed(
            "push", struck, goal, {}, lambda job: propose_push(replace(job, target=target)), request, options
        )
    low = min(points, key=lambda p: p.xyz[2])
    obj = _object_at(low, scene)
    button = button_of(obj, scene) if obj is not None else None
    if button is None:
        lowest = in_millimetres(low, scene)
        raise PlanningError(f"The closed hand touches nothing: its lowest point is {lowest}.")
    depth = {"press_depth": max(0.0, button.top + hand.tip_beyond_tcp - low.xyz[2])}
    return _followed("press", button, None, depth, propose_press, request, options)


def _followed(
    name: str,
    theme: SceneObject,
    goal: SceneObject | None,
    meant: Mapping[str, float],
    propose: Callable[[Job], Sequence[Proposal] | Abstention],
    request: PlanRequest,
    options: SkillOptions,
) -> Plan:
    """The plan by the path's proposals, with the numbers ``meant`` by the path limited by memory's bounds."""
    skill, hand = {**STANDARD, **request.skills}[name], request.arm.hand
    most = {p.name: p.most for p in skill.parameters}
    theta = dict(skill.defaults(theme, hand, options))
    theta |= {parameter: float(min(value, most.get(parameter, value))) for parameter, value in meant.items()}
    bounds = [e for e in request.advice.effects if isinstance(e, Bound)]
    theta, notes = apply_effects(theta, bounds, name, lengths=sides_of(theme))
    theta, limits = limited(theta, theme, request.scene)
    workspace = request.arm.workspace
    job = Job(name, request.scene, hand, workspace, theta, theme, goal, "on", grasp=options.grasp)
    refusal = f"The path to {name} the {theme.label} cannot be followed"
    request = replace(request, rejections=())  # a path has no alternatives
    return answer(job, skill, propose(job), request, options, refusal, [*notes, *limits])


def _take(points: Sequence[PathPoint], scene: Scene) -> int | None:
    """The index where the hand grasps: where it first closes, or the first point if the hand rises or opens later.

    None if there is no grasp: the hand pushes or presses.
    """
    for k in range(1, len(points)):
        if points[k].closed and not points[k - 1].closed:
            return k
    if not points[0].closed or len(points) < 2:
        return None
    obj = _object_at(points[0], scene)
    if obj is None or button_of(obj, scene) is not None:
        return None
    opens = any(not p.closed for p in points)
    rises = all(p.xyz[2] > points[0].xyz[2] + LEVEL for p in points[1:])
    return 0 if opens or rises else None


def _object_at(point: PathPoint, scene: Scene) -> SceneObject | None:
    """The solid object at a point: the one the point was written for, if close, else the nearest."""
    solids = scene.obstacles()
    gaps = {o.id: float(o.distances(point.array)) for o in solids}
    if point.at in gaps and gaps[point.at] < 2 * NEAR:
        return scene[point.at]
    best = min(solids, key=lambda o: (round(gaps[o.id], 3), float(np.prod(o.extents))), default=None)
    return best if best is not None and gaps[best.id] < NEAR else None


def _rest(
    points: Sequence[PathPoint], at: int, opened: int, theme: SceneObject, turn: float = 0.0
) -> PathPoint:
    """The point where the hand opens, moved to where the theme's middle is then: held off its middle, by a wall or a
    handle, the theme comes to lie beside the hand.
    """
    aside = Rotation.from_euler("z", turn).apply((theme.centre - points[at].array) * [1.0, 1.0, 0.0])
    x, y, z = (float(v) for v in points[opened].array + aside)
    return replace(points[opened], xyz=(x, y, z))


def _goal_at(point: PathPoint, scene: Scene, own: frozenset[str]) -> SceneObject | None:
    """The object or patch under a point: the one the point was written for, if close, else the highest one there."""
    if point.at and point.at not in own:
        meant = scene[point.at]
        if meant.distances(np.array([*point.xyz[:2], meant.centre[2]])) < NEAR:
            return meant
    under = [o for o in scene.objects if o.id not in own and o.covers(point.array)]
    return max(under, key=lambda o: (o.top, -float(np.prod(o.extents[:2]))), default=None)


def _struck(a: PathPoint, b: PathPoint, scene: Scene) -> SceneObject | None:
    """The first object that a straight motion along the table hits, or the one that its start was written for."""
    solids = {o.id: o for o in scene.obstacles() if not o.parent}
    if a.at in solids:
        return solids[a.at]
    for at in np.linspace(a.array, b.array, 60):
        for obj in solids.values():
            if at[2] < obj.top + NEAR and obj.distances([*at[:2], obj.centre[2]]) < 0.015:
                return obj
    return None


NEAREST = 24
"""The number of grasps, nearest to the point where the hand closes, that are considered."""
APPROACH = 0.12
"""Points within this horizontal distance of the grasp belong to its approach, metres."""
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
    touching = job.own | job.resting | (held.holders if held is not None else frozenset())
    here = draw_out(job, path, grasp)
    clear = max(job.rise - float(here[2] - grasp.centre[2]), 0.0)
    end = len(points) if opened is None else opened
    while opened is not None and end > at + 1:
        off = points[end - 1].array - points[opened].array
        if float(np.linalg.norm(off[:2])) >= CENTRED or off[2] >= LOWERED:
            break
        end -= 1  # the release itself: putting down leads there, and knows what may be touched
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
        rest = _rest(points, at, opened, job.theme, turn)
        _let_go(job, path, rest.array, grasp, turn, here, touching)
    how = grasp.description + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    cost = TURNED * (turn != 0.0)
    return Proposal(how, grasp.approaches, preference - cost, path.trajectory())


def _let_go(
    job: Job,
    path: Path,
    spot: FloatArray,
    grasp: Grasp,
    turn: float,
    here: FloatArray,
    touching: frozenset[str],
) -> None:
    """Go over the place of the theme's middle, lower and open the hand; at the goal's middle if ``spot`` (3,) is close
    to it.
    """
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
