"""One round of repair before a rejection: clamp, split, slow down, go over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.findings import MAX_SPEED, CheckReport, Finding
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, Orientation, Trajectory, Waypoint

VIA_MARGIN = 0.05
"""Height of a via-point above the highest object on the way, metres."""
TUBE = 0.08
"""Objects this near to a straight move, seen from above, count as on its way, metres (half a hand's breadth)."""


def repair(
    trajectory: Trajectory, report: CheckReport, scene: Scene, arm: Arm
) -> tuple[Trajectory, tuple[str, ...]]:
    """The trajectory after all possible repairs, and one sentence per change; unchanged and () if there are none.

    Positions are clamped into the workspace and above the table, openings into [0, 1], speeds lowered, long moves
    halved, and straight level moves that hit something led over it. It changes no orientation, drops no
    waypoint, and never exceeds the longest trajectory allowed. Check the result again.
    """
    points, said = list(trajectory.waypoints), []
    failed = [f for f in report.findings if not f.passed and 0 <= f.index < len(points)]
    for finding in failed:
        before = points[finding.index]
        points[finding.index] = _adjusted(before, finding, scene, arm)
        if points[finding.index] != before:
            said.append(_difference(finding.index, before, points[finding.index]))
    # From last to first, so that insertions do not shift the indices of pending repairs.
    for finding in sorted(failed, key=lambda f: -f.index):
        via = _via_points(points, finding, scene, arm)
        if via and len(points) + len(via) <= MAX_WAYPOINTS:
            points[finding.index : finding.index] = via
            way = ", ".join("(" + ", ".join(f"{v:.3f}" for v in w.xyz) + ")" for w in via)
            said.append(
                f"Before waypoint {finding.index}: via {way}, because {finding.kind.replace('_', ' ')}."
            )
    return (Trajectory(tuple(points)), tuple(said)) if said else (trajectory, ())


def _adjusted(w: Waypoint, finding: Finding, scene: Scene, arm: Arm) -> Waypoint:
    match finding.kind:
        case "outside_workspace":
            low = np.maximum(arm.workspace.low, scene.workspace.low)
            high = np.minimum(arm.workspace.high, scene.workspace.high)
            return replace(w, xyz=_xyz(np.clip(w.xyz, low, high)))
        case "table_margin" if finding.value is not None and finding.limit is not None:
            x, y, z = w.xyz
            return replace(w, xyz=(x, y, z + finding.limit - finding.value + 1e-4))
        case "too_fast":
            return replace(w, speed=MAX_SPEED)
        case "opening_range":
            return replace(w, gripper=float(np.clip(w.gripper, 0.0, 1.0)))
    return w


def _difference(index: int, before: Waypoint, after: Waypoint) -> str:
    changes = [
        f"{name} {_show(getattr(before, name))} -> {_show(getattr(after, name))}"
        for name in ("xyz", "speed", "gripper")
        if getattr(before, name) != getattr(after, name)
    ]
    return f"Waypoint {index} ({after.stage}): {', '.join(changes)}."


def _show(value: float | tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{v:.3f}" for v in value) + ")" if isinstance(value, tuple) else f"{value:.3g}"


def _via_points(points: list[Waypoint], finding: Finding, scene: Scene, arm: Arm) -> list[Waypoint]:
    """Waypoints to insert before the one the finding names."""
    if finding.index == 0 or finding.kind not in ("segment_too_long", "collision"):
        return []
    before, target = points[finding.index - 1], points[finding.index]
    a, b = np.asarray(before.xyz), np.asarray(target.xyz)
    step = replace(
        target, gripper=before.gripper, orientation=Orientation("hold"), stage=f"{target.stage} via"
    )
    if finding.kind == "segment_too_long":
        return [replace(step, xyz=_xyz(0.5 * (a + b)))]
    level = float(np.linalg.norm((b - a)[:2])) > abs(float(b[2] - a[2]))
    if target.motion != "linear" or not level:
        return []
    ignored = target.allowed_contacts | {target.carries}
    in_the_way = [o for o in scene.obstacles(frozenset(ignored)) if _near_line(o, a, b)]
    if not in_the_way:
        return []
    hangs = arm.hand.tip_beyond_tcp
    if target.carries and target.carries in {o.id for o in scene.objects}:
        hangs = max(hangs, float(scene[target.carries].extents.max()))
    height = max(o.top for o in in_the_way) + hangs + VIA_MARGIN
    ceiling = float(min(arm.workspace.high[2], scene.workspace.high[2]))
    if height > ceiling or height <= max(a[2], b[2]):
        return []
    return [replace(step, xyz=(float(p[0]), float(p[1]), height)) for p in (a, b)]


def _near_line(obj: SceneObject, a: FloatArray, b: FloatArray) -> bool:
    """Whether an object lies on the way from ``a`` to ``b`` (3,), seen from above."""
    along = (b - a)[:2]
    share = float(np.clip((obj.centre - a)[:2] @ along / max(float(along @ along), 1e-12), 0.0, 1.0))
    nearest = a[:2] + share * along
    reach = TUBE + 0.5 * float(np.linalg.norm(obj.extents[:2]))
    return bool(np.linalg.norm(obj.centre[:2] - nearest) < reach)


def _xyz(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
