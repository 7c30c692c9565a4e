"""One round of small repairs before a rejection: clamp, split, slow down, go over.

A planner's mistake of a few centimetres is mended; a larger one goes back to the planner with the checks' reasons, as
nobody knows what it meant.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.findings import MAX_SPEED, TABLE_MARGIN, CheckReport, Finding, FindingKind
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, Orientation, Trajectory, Waypoint

REACH = 0.05
"""Default limit of how far a repair moves a waypoint, metres."""
VIA_MARGIN = 0.05
"""Height of a via-point above the highest object on the way, metres."""
TUBE = 0.08
"""Objects this near to a straight move, seen from above, count as on its way, metres (half a hand's breadth)."""


def repair(
    trajectory: Trajectory,
    report: CheckReport,
    scene: Scene,
    arm: Arm,
    start_pose: FloatArray,
    reach: float = REACH,
) -> tuple[Trajectory, tuple[str, ...]]:
    """The trajectory after all possible repairs, and one sentence per change; unchanged and () if there are none.

    Positions are moved into the workspace and above the table, by at most ``reach`` metres in all; openings are clamped
    into [0, 1], speeds lowered, long moves halved, and straight level moves that hit something led over it. It changes
    no orientation, drops no waypoint, and never exceeds the longest trajectory allowed. If any waypoint would have to
    move further, nothing is repaired. ``start_pose`` (4, 4) is the tool's at the start. Check the result again.
    """
    points, notes = list(trajectory.waypoints), list[str]()
    failed = [f for f in report.findings if not f.passed and 0 <= f.index < len(points)]
    poses = trajectory.poses_if_valid(start_pose)
    for index in sorted({f.index for f in failed}):
        before, kinds = points[index], {f.kind for f in failed if f.index == index}
        down = 0.0 if poses is None else float(poses[index][2, 2])
        after = _adjusted(before, kinds, scene, arm, down)
        if np.linalg.norm(np.subtract(after.xyz, before.xyz)) > reach:
            return trajectory, ()
        if after != before:
            points[index] = after
            notes.append(_difference(index, before, after))
    # From last to first, so that insertions do not shift the indices of pending repairs.
    for finding in sorted(failed, key=lambda f: -f.index):
        via = _via_points(points, finding, scene, arm)
        if via and len(points) + len(via) <= MAX_WAYPOINTS:
            points[finding.index : finding.index] = via
            way = ", ".join("(" + ", ".join(f"{v:.3f}" for v in w.xyz) + ")" for w in via)
            reason = finding.kind.replace("_", " ")
            notes.append(f"Before waypoint {finding.index}: via {way}, because {reason}.")
    return (Trajectory(tuple(points)), tuple(notes)) if notes else (trajectory, ())


def _adjusted(w: Waypoint, kinds: set[FindingKind], scene: Scene, arm: Arm, down: float) -> Waypoint:
    """The waypoint with its faults mended, each from its present values: one correction may make another superfluous.

    ``down`` is the vertical component of the hand's approach, -1 if it points down.
    """
    if "outside_workspace" in kinds:
        low = np.maximum(arm.workspace.low, scene.workspace.low)
        high = np.minimum(arm.workspace.high, scene.workspace.high)
        w = replace(w, xyz=_xyz(np.clip(w.xyz, low, high)))
    if "table_margin" in kinds:
        lowest = scene.table_height + TABLE_MARGIN - down * arm.hand.tip_beyond_tcp
        x, y, z = w.xyz
        w = replace(w, xyz=(x, y, max(z, lowest + 1e-4)))
    if "too_fast" in kinds:
        w = replace(w, speed=MAX_SPEED)
    if "opening_range" in kinds:
        w = replace(w, gripper=float(np.clip(w.gripper, 0.0, 1.0)))
    return w


def _difference(index: int, before: Waypoint, after: Waypoint) -> str:
    changes = [
        f"{name} {_format(getattr(before, name))} -> {_format(getattr(after, name))}"
        for name in ("xyz", "speed", "gripper")
        if getattr(before, name) != getattr(after, name)
    ]
    return f"Waypoint {index} ({after.stage}): {', '.join(changes)}."


def _format(value: float | tuple[float, ...]) -> str:
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
