"""Checks that follow the arm along the waypoints: kinematics and swept clearance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.arm import Arm, Attachment, Hand, IKSolution
from gvla2.planning.findings import (
    EPS,
    FREE_CLEARANCE,
    JOINT_JUMP,
    LIMIT_MARGIN,
    LINEAR_CLEARANCE,
    MIN_MANIPULABILITY,
    SWEEP_STEP,
    Finding,
    FindingKind,
    Findings,
)
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
            end = _planned_end(arm, target, joints, trajectory.straight_after(i, poses))
            samples = [] if end is None else [end]
        solution = arm.inverse(target, near=samples[-1] if samples else joints)
        if samples:
            joints = np.asarray(samples[-1])
        legs.append(Leg(i, w, target, start, solution, samples, opening, attached))
        pose, opening = target, float(np.clip(w.gripper, 0.0, 1.0))
    return legs


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
        if _can_follow(arm, solution.joints, target, after):
            return solution.joints
    return first


def _can_follow(arm: Arm, joints: FloatArray, at: FloatArray, poses: Sequence[FloatArray]) -> bool:
    """Whether straight moves through tool poses (4, 4) work from the joints (dof,) and their pose ``at`` (4, 4)."""
    for pose in poses:
        if _still(at, pose):
            continue
        at = pose
        line = arm.line(joints, pose, 2 * LINE_STEP)
        if not line:
            return False
        joints = np.asarray(line[-1])
    return True


def _still(a: FloatArray, b: FloatArray) -> bool:
    turn = np.linalg.norm(a[:3, :3] - b[:3, :3]) / np.sqrt(2.0)  # radians, if small
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) < STILL and turn < STILL)


def check_kinematics(trajectory: Trajectory, legs: Sequence[Leg]) -> list[Finding]:
    """Every pose is solvable, straight moves are possible, away from joint limits, flips and singularities."""
    found = Findings("kinematics", trajectory)
    for leg in legs:
        if leg.solution is None:
            xyz = ", ".join(f"{v:.3f}" for v in leg.waypoint.xyz)
            message = f"no joints reach ({xyz}) with this orientation; move it nearer or turn the hand."
            found.fail(leg.index, "unreachable", message)
            continue
        if not leg.samples:
            message = "the arm cannot go there in a straight line; move 'free' or via a point."
            found.fail(leg.index, "no_straight_line", message)
            continue
        margin, ease = leg.solution.limit_margin, leg.solution.manipulability
        what = "a joint's distance to its limit (rad)"
        found.least(leg.index, "joint_limit", what, margin, LIMIT_MARGIN, "turn the hand")
        advice = "the pose is nearly singular; turn the hand or come nearer"
        found.least(leg.index, "singular", "the manipulability", ease, MIN_MANIPULABILITY, advice)
        if leg.waypoint.motion == "linear":
            jump = float(np.abs(np.diff(np.vstack([leg.start, *leg.samples]), axis=0)).max())
            what = "a joint's jump within one step of the straight move (rad)"
            found.most(leg.index, "joint_jump", what, jump, JOINT_JUMP, "move 'free'")
    return found.or_passed("Every waypoint is reachable, away from limits and singularities.")


def check_clearance(trajectory: Trajectory, legs: Sequence[Leg], scene: Scene, arm: Arm) -> list[Finding]:
    """Hand and held object clear of everything but ``allowed_contacts``; no grasp wider than the opening.

    Straight moves are checked along the way, planned ones at their start and end: in between, the motion planner keeps
    clear.
    """
    found = Findings("clearance", trajectory)
    for leg, following in zip_longest(legs, legs[1:]):
        if leg.samples:
            _check_leg(leg, scene, arm, found)
        if following is not None:
            _check_grasp(leg, following.waypoint.carries, scene, arm, found)
    return found.or_passed("Only allowed contacts are touched, and the grasp fits the hand.")


def _check_leg(leg: Leg, scene: Scene, arm: Arm, found: Findings) -> None:
    def gap(
        kind: FindingKind, all_joints: Sequence[FloatArray], opening: float, needed: float, advice: str
    ) -> bool:
        """Whether the arm keeps its distance at all of the joints."""
        allowed = leg.waypoint.allowed_contacts
        gaps = (arm.clearance(q, opening, scene, allowed, leg.attached) for q in all_joints)
        least = min(gaps, key=lambda clear: clear.distance)
        between = f"{least.robot_part or 'the arm'} and {least.other or 'the scene'}"
        return found.least(leg.index, kind, f"the gap between {between} (m)", least.distance, needed, advice)

    end = np.asarray(leg.samples[-1])
    if leg.waypoint.motion == "linear":
        stride = max(1, round(SWEEP_STEP / LINE_STEP))
        swept = [*map(np.asarray, leg.samples[:-1:stride]), end]
        advice = "go around by a via-point, or allow the contact (allowed_contacts)"
        clear = gap("collision", swept, leg.opening, LINEAR_CLEARANCE, advice)
    else:
        if leg.index > 0:
            advice = "this planned move starts there: first back off in a straight line"
            gap("blocked_start", [leg.start], leg.opening, FREE_CLEARANCE, advice)
        advice = "this planned move ends there: keep farther away"
        clear = gap("collision", [end], leg.opening, FREE_CLEARANCE, advice)
    if clear and abs(leg.waypoint.gripper - leg.opening) > EPS:
        opening = float(np.clip(leg.waypoint.gripper, 0.0, 1.0))
        advice = (
            "the hand opens or closes there: choose another opening, or allow the contact (allowed_contacts)"
        )
        gap("hand_blocked", [end], opening, LINEAR_CLEARANCE, advice)


def _check_grasp(leg: Leg, next_carried: str, scene: Scene, arm: Arm, found: Findings) -> None:
    """The hand must not close on an object wider than its opening."""
    if next_carried in ("", leg.waypoint.carries) or leg.waypoint.gripper >= leg.opening:
        return
    held = next((o for o in scene.objects if o.id == next_carried), None)
    if held is None:
        return
    width, opening = width_along(held, leg.pose[:3, 1]), leg.opening * arm.hand.max_width
    if width > opening and not part_fits(held, leg.pose, opening, arm.hand):
        what = f"the width of '{held.label}' between the fingers (m)"
        found.most(leg.index, "too_wide", what, width, opening, "open the hand more or grasp another side")


def part_fits(obj: SceneObject, world_from_tcp: FloatArray, opening: float, hand: Hand) -> bool:
    """Whether the hand, at the tool pose (4, 4) and ``opening`` metres wide, has a part of the object between its
    fingers and none where the fingers are: a nozzle, a handle, a wall. Judged by the object's seen points.
    """
    points = transform_points(invert_rigid(world_from_tcp), obj.points)
    points = points[np.abs(points[:, 0]) < 0.5 * hand.finger_breadth]
    points = points[np.abs(points[:, 2]) < hand.tip_beyond_tcp]
    off = np.abs(points[:, 1])
    struck = (off > 0.5 * opening) & (off < 0.5 * opening + hand.finger_thickness)
    return bool((off < 0.5 * opening).any() and not struck.any())


def width_along(obj: SceneObject, direction: FloatArray) -> float:
    """Extent of an object along a unit ``direction`` (3,), metres; round objects by their diameter.

    A cylinder's box may have any rotation about its axis, so its corners would overstate it by up to 41 %.
    """
    axes = obj.world_from_object[:3, :3]
    along = np.abs(direction @ axes)
    if obj.shape == "sphere":
        return float(obj.extents.max())
    if obj.shape in ("cylinder", "disc"):
        # Round about the frame's z: the width of a cylinder seen along any direction.
        return float(np.hypot(along[0], along[1]) * obj.extents[:2].max() + along[2] * obj.extents[2])
    return float(along @ obj.extents)
