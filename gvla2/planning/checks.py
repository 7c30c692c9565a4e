"""The six checks before motion: typed, and all of them reported.

1 schema, 2 workspace, 3 gripper, 4 kinematics, 5 clearance, 6 memory. None of them moves anything, and none stops at
the first fault: a planner that is asked again should get all findings at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.checks_gripper import check_gripper
from gvla2.planning.checks_motion import check_clearance, check_kinematics, resolve_motion
from gvla2.planning.effects import Bound, Effect, Order
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
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import MAX_WAYPOINTS, MIN_WAYPOINTS, Trajectory

UNRESOLVED = ("not_finite", "bad_orientation", "wrong_frame", "bad_motion")
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
    if n < MIN_WAYPOINTS:
        found.fail(
            -1, "too_few_waypoints", f"{n} waypoint(s); give at least {MIN_WAYPOINTS}.", n, MIN_WAYPOINTS
        )
    if n > MAX_WAYPOINTS:
        found.fail(
            -1, "too_many_waypoints", f"{n} waypoints; give at most {MAX_WAYPOINTS}.", n, MAX_WAYPOINTS
        )
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
    """The demands of remembered failures: bounds hold for the plan's parameters, its stages come in order.

    A bound in shares of a side applies if ``lengths`` (metres, by side) give that side of the handled object.
    """
    found, held, orders = Findings("memory", trajectory), 0, 0
    stages = [w.stage for w in trajectory]
    for effect in effects:
        if effect.skill not in ("", skill):
            continue
        origin = f" (from {effect.source})" if effect.source else ""
        match effect:
            case Order(earlier=earlier, later=later):
                orders += 1
                if effect.broken_by(stages):
                    message = (
                        f"The stage '{later}' comes before '{earlier}', the other way round than remembered{origin}; "
                        f"put '{earlier}' first."
                    )
                    found.fail(-1, "order_broken", message)
            case Bound(parameter=name) if name in parameters and (bound := effect.absolute(lengths)):
                held += 1
                value = parameters[name]
                if abs(bound.clamped(value) - value) > EPS:
                    share = f", {effect.value:.4g} of the object's {effect.scale}" if effect.scale else ""
                    message = (
                        f"{name} = {value:.4g} breaks the remembered bound {effect.op} "
                        f"{bound.value:.4g}{share}{origin}; change it."
                    )
                    found.fail(-1, "bound_broken", message, value, bound.value)
    rest = f" and {orders} order(s) of stages" if orders else ""
    return found.or_passed(f"{held} remembered bound(s){rest} hold.")
