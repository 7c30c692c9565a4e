"""Checks that read only the waypoints, without kinematics: schema, workspace, memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.check_limits import CheckLimits
from gvla2.planning.effects import Effect, disordered
from gvla2.planning.findings import CheckName, Finding
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import MAX_WAYPOINTS, MIN_WAYPOINTS, Trajectory, Waypoint

EPS = 1e-6


def where(index: int, waypoint: Waypoint) -> str:
    """How messages name a waypoint."""
    return f"Waypoint {index} ({waypoint.stage or 'no stage'})"


def passed(check: CheckName, message: str) -> Finding:
    """The finding of a check that found nothing wrong."""
    return Finding(check, True, message=message)


def check_schema(trajectory: Trajectory, scene: Scene) -> list[Finding]:
    """Count, frame, finite numbers, directions that define a rotation, ids that exist."""
    found: list[Finding] = []

    def fail(
        index: int, kind: str, message: str, value: float | None = None, limit: float | None = None
    ) -> None:
        found.append(Finding("schema", False, index, kind, message, value, limit))

    n = len(trajectory)
    if n < MIN_WAYPOINTS:
        fail(-1, "too_few_waypoints", f"{n} waypoint(s); give at least {MIN_WAYPOINTS}.", n, MIN_WAYPOINTS)
    if n > MAX_WAYPOINTS:
        fail(-1, "too_many_waypoints", f"{n} waypoints; give at most {MAX_WAYPOINTS}.", n, MAX_WAYPOINTS)
    known = {o.id for o in scene.objects}
    for i, w in enumerate(trajectory):
        name = where(i, w)
        if not w.stage:
            fail(i, "no_stage", f"{name}: the stage is empty; name the phase, such as 'approach'.")
        if w.frame != "world":
            fail(i, "wrong_frame", f"{name}: frame '{w.frame}' is unknown; give positions in 'world'.")
        if w.motion not in ("free", "linear"):
            fail(i, "bad_motion", f"{name}: motion '{w.motion}' is unknown; use 'free' or 'linear'.")
        numbers = [*w.xyz, w.gripper, w.speed, w.tolerance, w.dwell]
        if len(w.xyz) != 3 or not np.isfinite(numbers).all():
            fail(i, "not_finite", f"{name}: xyz {w.xyz}, gripper {w.gripper}, speed {w.speed}, tolerance "
                 f"{w.tolerance}, dwell {w.dwell}: three coordinates and finite numbers are needed.")  # fmt: skip
        elif w.speed <= 0 or w.tolerance <= 0:
            fail(i, "not_positive", f"{name}: speed {w.speed:g} m/s and tolerance {w.tolerance:g} m must be > 0.",
                 min(w.speed, w.tolerance), 0.0)  # fmt: skip
        elif w.dwell < 0:
            fail(i, "negative", f"{name}: a dwell of {w.dwell:g} s; give 0 s or more.", w.dwell, 0.0)
        if w.guard is not None and not w.guard.sound:
            fail(i, "bad_guard", f"{name}: guard force {w.guard.force} N, stall {w.guard.stall} m: finite numbers, "
                 "none below and one above zero, are needed.")  # fmt: skip
        if problem := _orientation_problem(w):
            fail(i, "bad_orientation", f"{name}: {problem}")
        strangers = (w.allowed_contacts | ({w.carries} if w.carries else set())) - known - {"table"}
        if strangers:
            fail(i, "unknown_object", f"{name} names {sorted(strangers)}, which the scene does not have; "
                 f"it has {sorted(known)}.")  # fmt: skip
    return found or [passed("schema", f"{n} waypoints, well formed.")]


def _orientation_problem(waypoint: Waypoint) -> str:
    """Why the orientation is not a rotation, or ""."""
    o = waypoint.orientation
    if o.policy not in ("hold", "grasp", "axis", "twist", "slerp"):
        return f"orientation policy '{o.policy}' is unknown; use hold, grasp, axis, twist or slerp."
    if o.policy == "hold":
        return ""
    vector, closing = np.asarray(o.vector, dtype=np.float64), np.asarray(o.closing, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not np.isfinite(o.angle):
        return "the orientation's vector and angle must be finite."
    if np.linalg.norm(vector) < EPS:
        return "the orientation's vector has no length."
    if o.policy in ("grasp", "slerp") and (
        closing.shape != (3,)
        or not np.isfinite(closing).all()
        or np.linalg.norm(np.cross(vector, closing)) < 1e-3 * np.linalg.norm(vector)
    ):
        return "the closing direction must be finite and not parallel to the approach."
    return ""


def check_workspace(
    trajectory: Trajectory, scene: Scene, arm: Arm, start_pose: FloatArray, limits: CheckLimits
) -> list[Finding]:
    """Positions inside both workspaces, fingertips above the table, moves neither too long nor too fast."""
    found: list[Finding] = []
    before = np.asarray(start_pose[:3, 3])
    poses = tool_poses(trajectory, start_pose)
    for i, w in enumerate(trajectory):
        xyz = np.asarray(w.xyz, dtype=np.float64)
        if xyz.shape != (3,) or not np.isfinite([*xyz, w.speed]).all():
            continue  # the schema check says so
        name = where(i, w)
        low = np.maximum(arm.workspace.low, scene.workspace.low)
        high = np.minimum(arm.workspace.high, scene.workspace.high)
        outside = float(np.max([low - xyz, xyz - high]))
        if outside > EPS:
            found.append(Finding("workspace", False, i, "outside_workspace",
                f"{name} at {_m(xyz)} is {outside:.3f} m outside the workspace {_m(low)} to {_m(high)}; move it in.",
                outside, 0.0))  # fmt: skip
        if "table" not in w.allowed_contacts and poses is not None:
            tip = float(xyz[2] + poses[i][2, 2] * arm.hand.tip_beyond_tcp) - scene.table_height
            if tip < limits.table_margin - EPS:
                found.append(Finding("workspace", False, i, "table_margin",
                    f"{name}: the fingertips end {tip * 1000:.1f} mm above the table, at least "
                    f"{limits.table_margin * 1000:.1f} mm are needed; raise it.",
                    tip, limits.table_margin))  # fmt: skip
        length, longest = float(np.linalg.norm(xyz - before)), _longest(w, limits)
        if length > longest:
            found.append(Finding("workspace", False, i, "segment_too_long",
                f"{name}: a {w.motion} move of {length:.2f} m, at most {longest:.2f} m; split it.",
                length, longest))  # fmt: skip
        if w.speed > limits.max_speed:
            found.append(Finding("workspace", False, i, "too_fast",
                f"{name}: {w.speed:.2f} m/s, at most {limits.max_speed:.2f} m/s; slow down.",
                w.speed, limits.max_speed))  # fmt: skip
        before = xyz
    return found or [passed("workspace", "Inside the workspace, above the table, within length and speed.")]


def _longest(waypoint: Waypoint, limits: CheckLimits) -> float:
    return limits.max_linear if waypoint.motion == "linear" else limits.max_free


def tool_poses(trajectory: Trajectory, start_pose: FloatArray) -> list[FloatArray] | None:
    """Tool poses, or None when an orientation is not one."""
    if any(_orientation_problem(w) or len(w.xyz) != 3 for w in trajectory):
        return None
    return trajectory.poses(start_pose)


def _m(xyz: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.3f}" for v in xyz) + ")"


def check_memory(
    effects: Iterable[Effect],
    parameters: Mapping[str, float],
    skill: str,
    *,
    lengths: Mapping[str, float] | None = None,
    stages: Sequence[str] = (),
) -> list[Finding]:
    """The demands of remembered failures: bounds hold for the plan's parameters, its stages come in order.

    A bound in shares of a side applies if ``lengths`` (metres, by side) give that side of the handled object.
    """
    found: list[Finding] = []
    own = [e for e in effects if e.skill in ("", skill)]
    bounds = [e for e in own if e.kind == "bound" and e.parameter in parameters]
    orders = [e for e in own if e.kind == "order"]
    held = 0
    for effect in bounds:
        if (bound := effect.absolute(lengths or {})) is None:
            continue
        held += 1
        value = parameters[effect.parameter]
        kept = value >= bound.value - EPS if bound.op == ">=" else value <= bound.value + EPS
        if not kept:
            share = f", {effect.value:.4g} of the object's {effect.scale}" if effect.scale else ""
            found.append(Finding("memory", False, -1, "bound_broken",
                f"{effect.parameter} = {value:.4g} breaks the remembered bound {effect.op} "
                f"{bound.value:.4g}{share}{_origin(effect)}; change it.", value, bound.value))  # fmt: skip
    for effect in orders:
        if disordered(effect, stages):
            earlier, later = effect.stages
            found.append(Finding("memory", False, -1, "order_broken",
                f"The stage '{later}' comes before '{earlier}', the other way round than "
                f"remembered{_origin(effect)}; put '{earlier}' first."))  # fmt: skip
    rest = f" and {len(orders)} order(s) of stages" if orders else ""
    return found or [passed("memory", f"{held} remembered bound(s){rest} hold.")]


def _origin(effect: Effect) -> str:
    return f" (from {effect.source})" if effect.source else ""
