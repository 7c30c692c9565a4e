"""Waypoints, grasps and common motions of the scripted solutions that prove each task feasible."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Orientation, Waypoint, grasp_rotation
from gvla2.robot.task import Solution, WorldState

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
    way: Literal["free", "linear"] = "free" if free else "linear"
    touched = frozenset(contacts)
    return Waypoint(_triple(xyz), gripper, stage, turned, way, speed, touched, carries, tolerance)


def through(
    stage: str,
    poses: Iterable[FloatArray],
    gripper: float,
    *,
    free: bool = False,
    speed: float = 0.15,
    **more: Any,
) -> list[Waypoint]:
    """Waypoints at tool poses (4, 4), with the options of :func:`stop`; ``free`` concerns the first."""
    return [
        stop(stage, pose[:3, 3], gripper, pose[:3, 2], pose[:3, 1], free=free and i == 0, speed=speed, **more)
        for i, pose in enumerate(poses)
    ]


def take(
    before: FloatArray,
    grasp: FloatArray,
    opening: float,
    contacts: Iterable[str],
    *,
    speed: float = 0.1,
    touching: bool = True,
) -> list[Waypoint]:
    """Approach ``before``, reach ``grasp`` (poses (4, 4)) and close.

    ``touching``: the ``contacts`` are already allowed on the approach.
    """
    near = frozenset(contacts)
    return [
        *through("approach", [before], opening, free=True, contacts=near if touching else ()),
        *through("reach", [grasp], opening, speed=speed, contacts=near),
        *through("grasp", [grasp], 0.0, contacts=near),
    ]


def let_go(pose: FloatArray, away: FloatArray, opening: float, contacts: Iterable[str]) -> list[Waypoint]:
    """Open the hand at ``pose`` and leave to ``away`` (4, 4)."""
    near = frozenset(contacts)
    return [
        *through("release", [pose], opening, contacts=near),
        *through("leave", [away], opening, contacts=near),
    ]


def best_closing(arm: Arm, points: Sequence[FloatArray], closings: Iterable[FloatArray]) -> FloatArray:
    """Of the closing directions (3,) of a hand that points down, the one whose joints stay furthest from their limits
    straight along ``points`` (3,).
    """
    choices = list(closings)
    rotations = [grasp_rotation(DOWN, closing) for closing in choices]
    return choices[best_path(arm, [[rigid(turn, point) for point in points] for turn in rotations])]


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


def raised(pose: FloatArray, height: float) -> FloatArray:
    """The pose (4, 4) moved up by ``height`` metres."""
    return rigid(translation=UP * height) @ np.asarray(pose)


def both(*directions: FloatArray) -> list[FloatArray]:
    """The directions and their opposites."""
    return [sign * direction for direction in directions for sign in (1.0, -1.0)]


def pick(
    obj: str,
    grasp: FloatArray,
    closing: FloatArray,
    lift: float,
    *,
    standoff: float = 0.10,
    contacts: Iterable[str] = (),
) -> list[Waypoint]:
    """Approach from above, close on ``obj`` with the tool at ``grasp`` (3,), and lift it; metres."""
    near = {obj, "table", *contacts}
    return [
        stop("approach", grasp + standoff * UP, 1.0, DOWN, closing, free=True, contacts=near),
        stop("reach", grasp, 1.0, speed=0.15, contacts=near),
        stop("grasp", grasp, 0.0, contacts=near),
        stop("lift", grasp + lift * UP, 0.0, speed=0.15, contacts=near, carries=obj),
    ]


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])


CARRIED, DROP = 0.15, 0.004


def put_on(
    obj: str,
    goal: str,
    size: FloatArray,
    *,
    depth: float | None = None,
    lift: float = CARRIED,
    rise: float = 0.0,
    base: bool = False,
    offset: FloatArray | None = None,
    contacts: Sequence[str] = (),
) -> Solution:
    """Put a box-like ``obj`` (full sides (3,) of ``size``, upright) on the origin of the body ``goal``.

    ``depth`` of the tool below the object's top, half its height at most; ``rise`` of its underside above the
    goal's origin; ``base``: the object's own origin is in its underside, not its middle; ``offset`` (3,) from the
    goal's origin, in its frame.
    """

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose, target = world.pose(obj), world.pose(goal)
        top = pose[:3, 3] + UP * size[2] * (1.0 if base else 0.5)
        grasp = top - UP * min(0.5 * size[2], depth or 0.03)
        place = target[:3, 3] + (0.0 if offset is None else target[:3, :3] @ offset)
        release = place + UP * (rise + DROP + size[2] + (grasp - top)[2])
        narrow = min(0.076, float(np.min(size[:2])) + 0.01)
        sides = [pose[:3, i] for i in (0, 1) if size[i] < narrow]
        above = release + UP * (lift - DROP)
        closing = best_closing(arm, [grasp, grasp + UP * lift], both(*sides))
        # How the object is turned when it is set down does not matter; how far the wrist can go does.
        turned = best_closing(arm, [above, release], around(UP, closing, 8))
        touched = {obj, goal, "table", *contacts}
        yield [
            *pick(obj, grasp, closing, lift, contacts=touched),
            stop("carry", above, 0.0, DOWN, turned, free=True, carries=obj, contacts=touched),
            stop("lower", release, 0.0, speed=0.1, carries=obj, contacts=touched),
            stop("release", release, 1.0, contacts=touched),
            stop("leave", above, 1.0, contacts=touched),
        ]

    return solve
