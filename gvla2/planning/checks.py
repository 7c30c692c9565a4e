"""The six checks before motion: typed, and all of them reported.

1 schema, 2 workspace, 3 gripper, 4 kinematics, 5 clearance, 6 memory. None of them moves anything, and none stops at
the first fault: a planner that is asked again should get all findings at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.arm import Arm, Hand
from gvla2.planning.checks_motion import check_clearance, check_kinematics, resolve_motion
from gvla2.planning.effects import Bound, Effect
from gvla2.planning.findings import (
    EPS,
    MAX_FREE,
    MAX_LINEAR,
    MAX_SPEED,
    TABLE_MARGIN,
    CheckReport,
    Finding,
    Findings,
)
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, MIN_WAYPOINTS, Trajectory, Waypoint

UNRESOLVED = ("not_finite", "bad_orientation", "bad_motion")
"""Faults of waypoints that the arm cannot be asked about."""


def check_trajectory(
    trajectory: Trajectory,
    scene: Scene,
    arm: Arm,
    start_pose: FloatArray,
    start_joints: FloatArray,
    effects: Iterable[Effect] = (),
    parameters: Mapping[str, float] | None = None,
    skill: str = "",
    lengths: Mapping[str, float] | None = None,
) -> CheckReport:
    """The findings on ``trajectory``, started at ``start_pose`` (4, 4) and ``start_joints`` (dof,), radians.

    Each check gives one passed finding, or one failed finding per problem. ``effects`` of kind ``bound`` must hold for
    the plan's ``parameters``; those limited to a skill apply if it is ``skill``, those in shares of a side of the
    handled object if ``lengths`` (metres, by side) give it. A malformed trajectory (not-a-number, no direction) fails
    ``kinematics`` and ``clearance`` as ``unchecked``.
    """
    schema = check_schema(trajectory, scene)
    findings = [*schema, *check_workspace(trajectory, scene, arm, start_pose)]
    findings += check_gripper(trajectory, scene, arm.hand, start_pose)
    if any(f.kind in UNRESOLVED for f in schema):
        reason = "could not be checked: the waypoints are malformed; mend what the schema check names first."
        findings.append(Finding("kinematics", False, -1, "unchecked", f"Kinematics {reason}"))
        findings.append(Finding("clearance", False, -1, "unchecked", f"Clearance {reason}"))
    else:
        legs = resolve_motion(trajectory, scene, arm, start_pose, start_joints)
        findings += check_kinematics(trajectory, legs)
        findings += check_clearance(trajectory, legs, scene, arm)
    findings += check_memory(trajectory, effects, parameters or {}, skill, lengths or {})
    return CheckReport(tuple(findings))


def check_schema(trajectory: Trajectory, scene: Scene) -> list[Finding]:
    """Count, well-formed waypoints, ids that exist."""
    found = Findings("schema", trajectory)
    n = len(trajectory)
    what = "the number of waypoints"
    found.least(-1, "too_few_waypoints", what, n, MIN_WAYPOINTS, "add one")
    found.most(-1, "too_many_waypoints", what, n, MAX_WAYPOINTS, "leave some out")
    known = {o.id for o in scene.objects}
    for i, w in enumerate(trajectory):
        if not w.stage:
            found.fail(i, "no_stage", "the stage is empty; name the phase, such as 'approach'.")
        for kind, message in w.faults():
            found.fail(i, kind, message)
        if strangers := (w.allowed_contacts | {w.carries}) - known - {"table", ""}:
            message = f"the scene has no {', '.join(sorted(strangers))}; it has {', '.join(sorted(known))}."
            found.fail(i, "unknown_object", message)
    return found.or_passed(f"{n} waypoints, well formed.")


def check_workspace(trajectory: Trajectory, scene: Scene, arm: Arm, start_pose: FloatArray) -> list[Finding]:
    """Positions inside both workspaces, fingertips above the table, moves neither too long nor too fast."""
    found = Findings("workspace", trajectory)
    before = np.asarray(start_pose[:3, 3])
    low = np.maximum(arm.workspace.low, scene.workspace.low)
    high = np.minimum(arm.workspace.high, scene.workspace.high)
    poses = trajectory.poses_if_valid(start_pose)
    for i, w in enumerate(trajectory):
        xyz = np.asarray(w.xyz, dtype=np.float64)
        if xyz.shape != (3,) or not np.isfinite([*xyz, w.speed]).all():
            continue  # the schema check says so
        outside = float(np.max([low - xyz, xyz - high]))
        if outside > EPS:
            message = (
                f"{_m(xyz)} is {outside:.3f} m outside the workspace {_m(low)} to {_m(high)}; move it in."
            )
            found.fail(i, "outside_workspace", message, outside, 0.0)
        if "table" not in w.allowed_contacts and poses is not None:
            tip = float(xyz[2] + poses[i][2, 2] * arm.hand.tip_beyond_tcp) - scene.table_height
            what = "the fingertips' height above the table (m)"
            found.least(i, "table_margin", what, tip, TABLE_MARGIN, "raise it")
        length, longest = (
            float(np.linalg.norm(xyz - before)),
            MAX_LINEAR if w.motion == "linear" else MAX_FREE,
        )
        found.most(i, "segment_too_long", f"the {w.motion} move's length (m)", length, longest, "split it")
        found.most(i, "too_fast", "the speed (m/s)", w.speed, MAX_SPEED, "slow down")
        before = xyz
    return found.or_passed("Inside the workspace, above the table, within length and speed.")


def _m(xyz: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.3f}" for v in xyz) + ")"


def check_memory(
    trajectory: Trajectory,
    effects: Iterable[Effect],
    parameters: Mapping[str, float],
    skill: str,
    lengths: Mapping[str, float],
) -> list[Finding]:
    """The bounds that remembered failures taught hold for the plan's parameters.

    A bound in shares of a side applies if ``lengths`` (metres, by side) give that side of the handled object.
    """
    found, held = Findings("memory", trajectory), 0
    for bound in effects:
        if not isinstance(bound, Bound) or bound.skill not in ("", skill):
            continue
        own = bound.absolute(lengths)
        if own is None or own.parameter not in parameters:
            continue
        held += 1
        name, value = own.parameter, parameters[own.parameter]
        if abs(own.clamped(value) - value) > EPS:
            share = f", {bound.value:.4g} of the object's {bound.scale}" if bound.scale else ""
            origin = f" (from {bound.source})" if bound.source else ""
            limit = f"{own.op} {own.value:.4g}{share}{origin}"
            message = f"{name} = {value:.4g} breaks the remembered bound {limit}; change it."
            found.fail(-1, "bound_broken", message, value, own.value)
    return found.or_passed(f"{held} remembered bound(s) hold.")


GRASP_REACH = 0.015
"""Largest distance of the grasped object from the space between the fingers, metres: perceived boxes are not exact."""
SHUT = 0.5
"""Openings below it count as closed: a hand that only narrows is preparing."""
TOOL_REACH, NEARER = 0.03, 0.005
"""A closed hand is a tool if it comes this near to an allowed contact, and this much nearer than where it closed."""
STEP = 0.01
"""Spacing of samples along a move of a closed hand, metres."""


def check_gripper(trajectory: Trajectory, scene: Scene, hand: Hand, start_pose: FloatArray) -> list[Finding]:
    """Open, close on an object, carry it closed, release it, stop carrying; no hand closes on nothing and leaves.

    ``Waypoint.gripper`` is reached after arriving, ``carries`` applies on the way: a waypoint that carries and opens is
    a release. A closed hand may be a tool: it presses, pushes or hooks what it is allowed to touch. If a waypoint is
    malformed (see the schema check), the space between the fingers is not checked.
    """
    found, waypoints = Findings("gripper", trajectory), trajectory.waypoints
    objects = {obj.id: obj for obj in scene.objects}
    finite = all(np.isfinite(w.xyz).all() for w in trajectory)
    poses = trajectory.poses_if_valid(start_pose) if finite else None
    opening = before = 1.0  # now, and where the hand last closed
    carried, closed, grasped = "", -1, False  # closed: the waypoint where the hand last closed
    grip = np.eye(4)  # the pose of the carried object in the hand
    for i, w in enumerate(trajectory):
        if not 0.0 <= w.gripper <= 1.0 and np.isfinite(w.gripper):
            found.fail(i, "opening_range", f"opening {w.gripper:g} is outside [0, 1].", w.gripper, 1.0)
        if w.carries and w.carries != carried:
            grasped = True
            if carried:
                message = f"it carries '{w.carries}' while '{carried}' was not released; open first."
                found.fail(i, "not_released", message)
            elif closed < 0:
                message = f"it carries '{w.carries}', on which the hand has not closed; close at it first."
                found.fail(i, "carries_without_grasp", message, opening, 1.0)
            elif w.carries in objects and poses is not None:
                gap = _gap(objects[w.carries], poses[closed], before, hand)
                what = f"the gap between the closing hand and '{w.carries}' (m)"
                found.most(closed, "grasp_misses", what, gap, GRASP_REACH, "close on the object")
                grip = invert_rigid(poses[closed]) @ objects[w.carries].world_from_object
        elif carried and not w.carries and closed >= 0:
            message = f"it no longer carries '{carried}', but the hand did not open; open it or carry on."
            found.fail(i, "dropped_silently", message)
        carried = w.carries
        opens = w.gripper > opening + EPS
        if w.gripper < opening - EPS:
            before, closed, grasped = opening, i, False
        elif opens and carried and any(after.carries == carried for after in waypoints[i + 1 : i + 2]):
            message = f"the hand opens to {w.gripper:g} while it still carries '{carried}'; keep it closed."
            found.fail(i, "opens_while_carrying", message, w.gripper, opening)
        opening = w.gripper
        if opens or i == len(waypoints) - 1:
            if poses is not None and carried in objects:
                objects[carried] = replace(objects[carried], world_from_object=poses[i] @ grip)
            elif poses is not None and closed >= 0 and not grasped:
                after = waypoints[closed + 1 : i + 1]
                _closed_on(closed, after, objects, poses[closed], before, hand, found)
            carried, closed, grasped = "", -1, False
    return found.or_passed("Closes, carries and releases in order.")


def _closed_on(
    index: int,
    after: Sequence[Waypoint],
    objects: Mapping[str, SceneObject],
    pose: FloatArray,
    opening: float,
    hand: Hand,
    found: Findings,
) -> None:
    """A hand that closed at waypoint ``index`` and leaves needs something between its fingers, or is a tool."""
    closed = found.trajectory.waypoints[index]
    away = any(np.linalg.norm(np.subtract(w.xyz, closed.xyz)) > STEP for w in after)
    if closed.gripper >= SHUT or not away:
        return
    gaps = {o.id: _gap(o, pose, opening, hand) for o in objects.values() if o.shape != "region"}
    nearest = min(gaps, key=lambda name: gaps[name], default="")
    gap = gaps.get(nearest, np.inf)
    if gap > GRASP_REACH and not _is_tool(closed, after, objects):
        near = f" (the nearest, '{nearest}', is {1000 * gap:.0f} mm off)" if nearest else ""
        message = (
            f"the hand closes where nothing is between its fingers{near}, and leaves; close on an object, or "
            "name what the closed hand touches in allowed_contacts."
        )
        found.fail(index, "closes_on_nothing", message, gap, GRASP_REACH)


def _is_tool(closed: Waypoint, after: Sequence[Waypoint], objects: Mapping[str, SceneObject]) -> bool:
    """Whether the closed hand moves to touch something: a guard waits for it, or it approaches an allowed contact."""
    before = closed
    for w in after:
        if w.guard is not None:
            return True
        for obj in (objects[name] for name in w.allowed_contacts if name in objects):
            nearest = float(obj.distances(_way(before, w)).min())
            if nearest < min(TOOL_REACH, float(obj.distances(closed.xyz)) - NEARER):
                return True
        before = w
    return False


def _way(before: Waypoint, w: Waypoint) -> FloatArray:
    """(N, 3) points of the tool along the move to a waypoint."""
    a, b = np.asarray(before.xyz), np.asarray(w.xyz)
    return np.linspace(a, b, max(2, int(np.ceil(np.linalg.norm(b - a) / STEP)) + 1))


def _gap(obj: SceneObject, world_from_tcp: FloatArray, opening: float, hand: Hand) -> float:
    """Distance of an object's box from the space between the fingers, ``opening`` in [0, 1], metres; 0 within it."""
    half = 0.5 * float(np.clip(opening, 0.0, 1.0)) * hand.max_width
    tip = hand.tip_beyond_tcp
    x = np.linspace(-0.5, 0.5, 3) * hand.finger_breadth
    y = np.linspace(-half, half, 9)
    z = np.linspace(tip - hand.finger_length, tip, 5)
    between = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(obj.distances(transform_points(world_from_tcp, between)).min())
