"""Programs of several calls: which of them make one plan, and that plan.

Picking an object up and then placing it is one placement; several placements into containers are one trajectory if it
is short enough. Any other call is planned alone, so that the robot looks again before the next.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.calls import SkillCall
from gvla2.planning.checks_motion import resolve_motion
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, Trajectory, Waypoint
from gvla2.skills.grounding import meant, whole_meant

MOST = 3
"""Most objects in one trajectory: it has at most 20 waypoints, and each object takes six."""
WIDE = 0.06
"""A container's opening is wider than this, metres, so that objects fit side by side."""
INTO = ("", "on", "in", "to")


@dataclass(frozen=True)
class Part:
    """Calls that make one plan. Each merges ``took`` calls of the program; its ``shares`` (k, n) say that it is the
    k-th of n calls with its goal.
    """

    calls: tuple[SkillCall, ...]
    took: tuple[int, ...]
    shares: tuple[tuple[int, int], ...]


def first_part(program: Sequence[SkillCall], scene: Scene) -> Part:
    """The first part of a program whose skills and objects all exist."""
    calls: list[SkillCall] = []
    took: list[int] = []
    at = 0
    while at < len(program) and len(calls) < MOST:
        call, count = _merged(program[at:], scene)
        if calls and not _goes_along(call, calls, scene):
            break
        calls.append(call)
        took.append(count)
        at += count
        if not _fills(call, scene):
            break
    goals = [c.goal for c in calls]
    shares = tuple((goals[:k].count(g), goals.count(g)) if g else (0, 1) for k, g in enumerate(goals))
    return Part(tuple(calls), tuple(took), shares)


def _merged(rest: Sequence[SkillCall], scene: Scene) -> tuple[SkillCall, int]:
    """The first call, merged with the next if that places what the first one picks, and the number of calls used."""
    first = rest[0]
    if len(rest) < 2 or rest[1].skill != "place" or first.goal or first.xy or first.direction:
        return first, 1
    what, then = meant(first, scene), rest[1]
    if isinstance(what, Abstention) or what.skill not in ("pick", "twist", "draw"):
        return first, 1
    same = {first.theme, what.theme.id}
    if what.skill == "pick":
        same |= {whole_meant(scene[i], scene).id for i in same}
        same |= {i for i in [then.theme] if whole_meant(scene[i], scene).id in same}
    if then.theme not in same:
        return first, 1
    theta = {**first.theta, **then.theta}
    if what.skill == "pick":
        theta.pop("lift_height", None)  # placing has its own lift
        return replace(then, theta=theta), 2
    return replace(then, skill=what.skill, theme=what.theme.id, theta=theta), 2


def _goes_along(call: SkillCall, calls: Sequence[SkillCall], scene: Scene) -> bool:
    """Whether a call can be planned without looking again: it fills a container, too, and moves another object."""
    themes, goals = {c.theme for c in calls}, {c.goal for c in calls}
    return _fills(call, scene) and call.theme not in themes | goals and call.goal not in themes


def _fills(call: SkillCall, scene: Scene) -> bool:
    return (
        call.skill == "place" and call.relation in INTO and bool(call.goal) and is_container(scene[call.goal])
    )


def is_container(obj: SceneObject) -> bool:
    """Whether it is for putting objects into: open at the top, and lower than wide."""
    wide = float(obj.extents[:2].min())
    whole = obj.shape != "region" and not obj.parent
    return whole and obj.opening > WIDE and obj.top - obj.bottom < wide


PlanOne = Callable[[SkillCall, PlanRequest, tuple[int, int]], Plan]


def all_in_one(part: Part, request: PlanRequest, plan_one: PlanOne) -> Plan:
    """One plan for the calls of a part; a refusal by ``plan_one`` refuses all.

    Calls that do not fit in the longest trajectory, or that are feasible only from the arm's first pose, are left out:
    the plan's ``calls`` are those in it.
    """
    waypoints: list[Waypoint] = []
    now, last, done = request, Plan(None), 0
    notes: list[str] = []
    for call, share in zip(part.calls, part.shares, strict=True):
        plan = plan_one(call, now, share)
        if plan.trajectory is None:
            rested = replace(now, start=request.start, joints=request.joints)
            if done and plan_one(call, rested, share).trajectory is not None:
                break
            return replace(plan, calls=part.calls)
        more = brief(plan.trajectory)
        if done and len(waypoints) + len(more) > MAX_WAYPOINTS:
            break
        last, done = plan, done + 1
        waypoints += more
        notes += [n for n in plan.notes if n not in notes]
        now = after(now.scene[plan.roles["theme"]], plan.trajectory, now)
    if done == 1:
        return last
    roles = {f"theme_{k + 1}": call.theme for k, call in enumerate(part.calls[:done])}
    return replace(
        last,
        trajectory=Trajectory(tuple(waypoints)),
        roles={**last.roles, **roles},
        notes=tuple(notes),
        calls=part.calls[:done],
    )


def brief(trajectory: Trajectory) -> list[Waypoint]:
    """The waypoints with the hand closing or opening on arrival instead of at a separate waypoint."""
    kept: list[Waypoint] = []
    for waypoint in trajectory:
        before = kept[-1] if kept else None
        grips_only = (
            before is not None
            and before.xyz == waypoint.xyz
            and before.orientation == waypoint.orientation
            and before.carries == waypoint.carries
        )
        if before is not None and grips_only:
            kept[-1] = replace(before, gripper=waypoint.gripper, stage=waypoint.stage)
        else:
            kept.append(waypoint)
    return kept


def after(obj: SceneObject, trajectory: Trajectory, request: PlanRequest) -> PlanRequest:
    """The request after the trajectory: the object moved, the arm at the end."""
    legs = resolve_motion(trajectory, request.scene, request.arm, request.start, request.joints)
    held = [leg for leg in legs if leg.waypoint.carries == obj.id]
    if not held:
        return request
    taken = legs[held[0].index - 1].pose
    moved = held[-1].pose @ invert_rigid(taken)
    joints = next((np.asarray(leg.samples[-1]) for leg in reversed(legs) if leg.samples), request.joints)
    return replace(request, scene=_moved(obj, moved, request.scene), start=legs[-1].pose, joints=joints)


def _moved(obj: SceneObject, by: FloatArray, scene: Scene) -> Scene:
    own = scene.family(obj.id)
    for each in scene.objects:
        if each.id in own:
            pose, points = by @ each.world_from_object, transform_points(by, each.points)
            scene = scene.with_object(replace(each, world_from_object=pose, points=points))
    return scene
