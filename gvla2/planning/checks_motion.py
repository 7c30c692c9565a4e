"""Checks that follow the arm along the waypoints: kinematics and swept clearance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.arm import Arm, Attachment, Clearance, Hand, IKSolution
from gvla2.planning.check_limits import CheckLimits
from gvla2.planning.checks_words import passed, where
from gvla2.planning.findings import CheckName, Finding
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint

LINE_STEP = 0.01
STILL = 1e-4
"""A move below this (metres and radians) does not count: the hand only opens or closes."""


@dataclass(frozen=True)
class Leg:
    """The move to one waypoint, solved from the end of the previous leg.

    ``solution`` is None when the pose is out of reach; ``samples`` are the joints along a straight move, or only the
    last joints of a planned one, empty if there is no path. ``opening`` is the hand's during the move, and ``attached``
    what it carries.
    """

    index: int
    waypoint: Waypoint
    pose: FloatArray
    start: FloatArray
    solution: IKSolution | None
    samples: Sequence[FloatArray]
    opening: float
    attached: Attachment | None


def resolve_motion(
    trajectory: Trajectory, scene: Scene, arm: Arm, start_pose: FloatArray, start_joints: FloatArray
) -> list[Leg]:
    """All legs, each from the joints where the previous one ended; after an impossible leg, from where that began.

    A redundant arm reaches the end of a planned move in many ways. Like the motion planner, this prefers solutions from
    which the following straight moves are possible.
    """
    legs: list[Leg] = []
    joints, pose, opening = np.asarray(start_joints, dtype=np.float64), start_pose, 1.0
    attached: Attachment | None = None
    objects = {o.id: o for o in scene.objects}
    poses = trajectory.poses(start_pose)
    for i, (w, target) in enumerate(zip(trajectory, poses, strict=True)):
        if not w.carries:
            attached = None
        elif w.carries in objects and (attached is None or attached.object.id != w.carries):
            held = objects[w.carries]
            attached = Attachment(held, invert_rigid(pose) @ held.world_from_object)
        start = joints
        samples: Sequence[FloatArray]
        if _still(pose, target):
            samples = [joints]
        elif w.motion == "linear":
            samples = list(arm.line(joints, target, LINE_STEP) or ())
        else:
            after = _straight_after(trajectory, poses, i)
            end = _planned_end(arm, target, joints, after)
            samples = [] if end is None else [end]
        solution = arm.inverse(target, near=samples[-1] if samples else joints)
        if samples:
            joints = np.asarray(samples[-1])
        legs.append(Leg(i, w, target, start, solution, samples, opening, attached))
        pose, opening = target, float(np.clip(w.gripper, 0.0, 1.0))
    return legs


def _straight_after(trajectory: Trajectory, poses: Sequence[FloatArray], index: int) -> list[FloatArray]:
    """Poses of the straight moves right after a waypoint."""
    after: list[FloatArray] = []
    for waypoint, pose in zip(trajectory.waypoints[index + 1 :], poses[index + 1 :], strict=True):
        if waypoint.motion != "linear":
            break
        if not _still(after[-1] if after else poses[index], pose):
            after.append(pose)
    return after


def _planned_end(
    arm: Arm, target: FloatArray, joints: FloatArray, after: Sequence[FloatArray]
) -> FloatArray | None:
    """Joints at the end of a planned move: nearest to ``joints`` if the straight moves after it work from there."""
    first: FloatArray | None = None
    for seed in (joints, arm.home):
        solution = arm.inverse(target, near=seed)
        if solution is None:
            continue
        first = solution.joints if first is None else first
        if _can_follow(arm, solution.joints, after):
            return solution.joints
    return first


def _can_follow(arm: Arm, joints: FloatArray, poses: Sequence[FloatArray]) -> bool:
    for pose in poses:
        line = arm.line(joints, pose, 2 * LINE_STEP)
        if not line:
            return False
        joints = np.asarray(line[-1])
    return True


def _still(a: FloatArray, b: FloatArray) -> bool:
    turn = np.linalg.norm(a[:3, :3] - b[:3, :3]) / np.sqrt(2.0)  # radians, if small
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) < STILL and turn < STILL)


def check_kinematics(legs: Sequence[Leg], limits: CheckLimits) -> list[Finding]:
    """Every pose is solvable, straight moves are possible, away from joint limits, flips and singularities."""
    found: list[Finding] = []

    def fail(
        leg: Leg, kind: str, message: str, value: float | None = None, limit: float | None = None
    ) -> None:
        text = f"{where(leg.index, leg.waypoint)}: {message}"
        found.append(Finding("kinematics", False, leg.index, kind, text, value, limit))

    for leg in legs:
        if leg.solution is None:
            xyz = ", ".join(f"{v:.3f}" for v in leg.waypoint.xyz)
            fail(
                leg,
                "unreachable",
                f"no joints reach ({xyz}) with this orientation; move it nearer or turn the hand.",
            )
            continue
        if not leg.samples:
            fail(
                leg,
                "no_straight_line",
                "the arm cannot go there in a straight line; move 'free' or via a point.",
            )
            continue
        if leg.solution.limit_margin < limits.limit_margin:
            fail(leg, "joint_limit", f"a joint is {leg.solution.limit_margin:.3f} rad from its limit, at least "
                 f"{limits.limit_margin:.3f} rad are needed; turn the hand.",
                 leg.solution.limit_margin, limits.limit_margin)  # fmt: skip
        if leg.solution.manipulability < limits.min_manipulability:
            fail(leg, "singular", f"manipulability {leg.solution.manipulability:.4f} is near a singularity, at least "
                 f"{limits.min_manipulability:.4f} is needed; turn the hand or come nearer.",
                 leg.solution.manipulability, limits.min_manipulability)  # fmt: skip
        if leg.waypoint.motion == "linear":
            path = np.vstack([leg.start, *leg.samples])
            jump = float(np.abs(np.diff(path, axis=0)).max())
            if jump > limits.joint_jump:
                fail(leg, "joint_jump", f"a joint jumps {jump:.2f} rad within one step of the straight move, at most "
                     f"{limits.joint_jump:.2f} rad; move 'free'.", jump, limits.joint_jump)  # fmt: skip
    return found or [passed("kinematics", "Every waypoint is reachable, away from limits and singularities.")]


def check_clearance(legs: Sequence[Leg], scene: Scene, arm: Arm, limits: CheckLimits) -> list[Finding]:
    """Hand and held object clear of everything but ``allowed_contacts``; no grasp wider than the opening.

    Straight moves are checked along the way, planned ones at their start and end: in between, the motion planner keeps
    clear.
    """
    found: list[Finding] = []
    for leg in legs:
        if leg.samples:
            found += _leg_clearance(leg, scene, arm, limits)
        if (grasp := _grasp_width(leg, legs, scene, arm)) is not None:
            found.append(grasp)
    return found or [passed("clearance", "Only allowed contacts are touched, and the grasp fits the hand.")]


def _leg_clearance(leg: Leg, scene: Scene, arm: Arm, limits: CheckLimits) -> list[Finding]:
    def measure(joints: FloatArray, opening: float) -> Clearance:
        return arm.clearance(joints, opening, scene, leg.waypoint.allowed_contacts, leg.attached)

    name, found = where(leg.index, leg.waypoint), []
    end = np.asarray(leg.samples[-1])
    if leg.waypoint.motion == "linear":
        stride = max(1, round(limits.sweep_step / LINE_STEP))
        swept = [*leg.samples[:-1:stride], end]
        worst = min((measure(np.asarray(q), leg.opening) for q in swept), key=lambda c: c.distance)
        needed, kind, advice = (
            limits.linear_clearance,
            "collision",
            "go around by a via-point, or allow the contact.",
        )
    else:
        starting = measure(leg.start, leg.opening)
        if leg.index > 0 and starting.distance < limits.free_clearance:
            found.append(_too_close(leg.index, "blocked_start", name, starting, limits.free_clearance,
                                    "where this planned move starts; back off in a straight line first."))  # fmt: skip
        worst = measure(end, leg.opening)
        needed, kind, advice = (
            limits.free_clearance,
            "collision",
            "at the end of this planned move; keep away more.",
        )
    if worst.distance < needed:
        found.append(_too_close(leg.index, kind, name, worst, needed, advice))
    elif abs(leg.waypoint.gripper - leg.opening) > 1e-6:
        after = measure(end, float(np.clip(leg.waypoint.gripper, 0.0, 1.0)))
        if after.distance < limits.linear_clearance:
            found.append(_too_close(leg.index, "hand_blocked", name, after, limits.linear_clearance,
                                    "after the hand opened or closed; choose another opening."))  # fmt: skip
    return found


def _too_close(index: int, kind: str, name: str, clear: Clearance, needed: float, advice: str) -> Finding:
    check: CheckName = "clearance"
    between = f"{clear.robot_part or 'the arm'} and {clear.other or 'the scene'}"
    message = f"{name}: {clear.distance * 1000:.1f} mm between {between}, {needed * 1000:.1f} mm are needed {advice}"
    return Finding(check, False, index, kind, message, clear.distance, needed)


def _grasp_width(leg: Leg, legs: Sequence[Leg], scene: Scene, arm: Arm) -> Finding | None:
    """A finding when the hand closes here on an object wider than its opening."""
    following = legs[leg.index + 1].waypoint.carries if leg.index + 1 < len(legs) else ""
    if not following or following == leg.waypoint.carries or leg.waypoint.gripper >= leg.opening:
        return None
    held = next((o for o in scene.objects if o.id == following), None)
    if held is None:
        return None
    width, opening = width_along(held, leg.pose[:3, 1]), leg.opening * arm.hand.max_width
    if width <= opening or part_fits(held, leg.pose, opening, arm.hand):
        return None
    return Finding("clearance", False, leg.index, "too_wide",
        f"{where(leg.index, leg.waypoint)}: '{held.label}' is {width * 1000:.0f} mm wide where the hand is open "
        f"{opening * 1000:.0f} mm; open it more or grasp another side.", width, opening)  # fmt: skip


def part_fits(thing: SceneObject, world_from_tcp: FloatArray, opening: float, hand: Hand) -> bool:
    """Whether the hand, at the tool pose (4, 4) and ``opening`` metres wide, has a part of the object between its
    fingers and none where the fingers are: a nozzle, a handle, a wall. Judged by the object's seen points.
    """
    points = transform_points(invert_rigid(world_from_tcp), thing.points)
    points = points[np.abs(points[:, 0]) < 0.5 * hand.finger_breadth]
    points = points[np.abs(points[:, 2]) < hand.tip_beyond_tcp]
    off = np.abs(points[:, 1])
    struck = (off > 0.5 * opening) & (off < 0.5 * opening + hand.finger_thickness)
    return bool((off < 0.5 * opening).any() and not struck.any())


def width_along(thing: SceneObject, direction: FloatArray) -> float:
    """Extent of an object along a unit ``direction`` (3,), metres; round things by their diameter.

    A cylinder's box may have any rotation about its axis, so its corners would overstate it by up to 41 %.
    """
    axes = thing.world_from_object[:3, :3]
    along = np.abs(direction @ axes)
    if thing.shape == "sphere":
        return float(thing.extents.max())
    if thing.shape in ("cylinder", "disc"):
        # Round about the frame's z: the width of a cylinder seen along any direction.
        return float(np.hypot(along[0], along[1]) * thing.extents[:2].max() + along[2] * thing.extents[2])
    return float(along @ thing.extents)
