"""Waypoints and grasps for building demonstrations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Orientation, Waypoint, grasp_rotation

DOWN = np.array([0.0, 0.0, -1.0])
UP = np.array([0.0, 0.0, 1.0])


def stop(
    stage: str,
    xyz: FloatArray,
    gripper: float,
    approach: FloatArray | None = None,
    closing: FloatArray | None = None,
    *,
    free: bool = False,
    speed: float = 0.25,
    contacts: Iterable[str] = (),
    carries: str = "",
    tolerance: float = 0.01,
) -> Waypoint:
    """A waypoint; ``approach`` and ``closing`` (3,) turn the hand, without them it stays as it was."""
    turned = Orientation()
    if approach is not None and closing is not None:
        turned = Orientation("grasp", _triple(approach), _triple(closing))
    return Waypoint(
        _triple(xyz),
        gripper,
        stage,
        turned,
        "free" if free else "linear",
        speed,
        frozenset(contacts),
        carries,
        tolerance,
    )


def through(
    stage: str,
    poses: Iterable[FloatArray],
    gripper: float,
    *,
    free: bool = False,
    speed: float = 0.15,
    contacts: Iterable[str] = (),
    carries: str = "",
    tolerance: float = 0.01,
) -> list[Waypoint]:
    """Waypoints at tool poses (4, 4); ``free`` concerns the first."""
    touched = frozenset(contacts)
    return [
        stop(
            stage, pose[:3, 3], gripper, pose[:3, 2], pose[:3, 1], free=free and i == 0, speed=speed,
            contacts=touched, carries=carries, tolerance=tolerance,
        )
        for i, pose in enumerate(poses)
    ]  # fmt: skip


def best_closing(
    arm: Arm,
    points: Sequence[FloatArray],
    closings: Iterable[FloatArray],
    approach: FloatArray = DOWN,
    turn: float = 0.0,
) -> FloatArray:
    """Of the closing directions (3,), the one whose joints stay furthest from their limits along ``points`` (3,).

    The tool must get from the first point to each next one on a straight line, and then, where ``turn`` (radians,
    about the approach) is given, turn on the spot.
    """
    choices = list(closings)
    paths = []
    for closing in choices:
        rotation = grasp_rotation(approach, closing)
        poses = [rigid(rotation, point) for point in points]
        for share in np.linspace(0.0, 1.0, 4)[1:] if turn else ():
            about = Rotation.from_rotvec(approach * turn * share).as_matrix()
            poses.append(rigid(about @ rotation, points[-1]))
        paths.append(poses)
    return choices[best_path(arm, paths)]


def best_path(arm: Arm, paths: Sequence[Sequence[FloatArray]]) -> int:
    """Which of several lists of tool poses (4, 4) keeps the joints furthest from their limits, straight through."""
    return int(np.argmax([_least_margin(arm, poses) for poses in paths]))


def _least_margin(arm: Arm, poses: Sequence[FloatArray]) -> float:
    """Smallest distance to a joint limit at the poses (4, 4), radians; -1 when a straight line breaks off."""
    first = arm.inverse(poses[0])
    if first is None:
        return -1.0
    joints, margin = first.joints, first.limit_margin
    for pose in poses[1:]:
        line = arm.line(joints, pose, 0.03)
        if line is None:
            return -1.0
        joints = line[-1]
        here = arm.inverse(pose, joints)
        margin = min(margin, -1.0 if here is None else here.limit_margin)
    return margin


def around(axis: FloatArray, start: FloatArray, count: int) -> list[FloatArray]:
    """``count`` directions (3,): ``start`` turned evenly all the way about ``axis``."""
    return [
        Rotation.from_rotvec(axis * turn).as_matrix() @ start
        for turn in 2.0 * np.pi * np.arange(count) / count
    ]


def both(*directions: FloatArray) -> list[FloatArray]:
    """The directions and their opposites."""
    return [sign * direction for direction in directions for sign in (1.0, -1.0)]


def pick(
    thing: str,
    grasp: FloatArray,
    closing: FloatArray,
    lift: float,
    approach: FloatArray = DOWN,
    *,
    standoff: float = 0.10,
    contacts: Iterable[str] = (),
    opening: float = 1.0,
    away: FloatArray = UP,
) -> list[Waypoint]:
    """Approach, close on ``thing`` with the tool at ``grasp`` (3,), and lift it by ``lift`` along ``away``."""
    touched = {thing, "table", *contacts}
    return [
        stop(
            "approach", grasp - standoff * approach, opening, approach, closing, free=True, contacts=touched
        ),
        stop("reach", grasp, opening, speed=0.15, contacts=touched),
        stop("grasp", grasp, 0.0, contacts=touched),
        stop("lift", grasp + lift * away, 0.0, speed=0.15, contacts=touched, carries=thing),
    ]


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
