"""One plan for several calls: the scene after each, and few enough waypoints for all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.calls import SkillCall
from gvla2.planning.checks_motion import resolve_motion
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, Trajectory, Waypoint
from gvla2.skills.chaining import Part

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


def after(thing: SceneObject, trajectory: Trajectory, request: PlanRequest) -> PlanRequest:
    """The request after the trajectory: the object moved, the arm at the end."""
    legs = resolve_motion(trajectory, request.scene, request.arm, request.start, request.joints)
    held = [leg for leg in legs if leg.waypoint.carries == thing.id]
    if not held:
        return request
    taken = legs[held[0].index - 1].pose
    moved = held[-1].pose @ invert_rigid(taken)
    joints = next((np.asarray(leg.samples[-1]) for leg in reversed(legs) if leg.samples), request.joints)
    return replace(request, scene=_moved(thing, moved, request.scene), start=legs[-1].pose, joints=joints)


def _moved(thing: SceneObject, by: FloatArray, scene: Scene) -> Scene:
    own = scene.family(thing.id)
    for each in scene.objects:
        if each.id in own:
            pose, points = by @ each.world_from_object, transform_points(by, each.points)
            scene = scene.with_object(replace(each, world_from_object=pose, points=points))
    return scene
