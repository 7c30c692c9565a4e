"""Static checks: nothing is sent to an arm that is not finite, inside the limits and continuous."""

from __future__ import annotations

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, Waypoint


def check_trajectory(trajectory: Trajectory, scene: Scene, start: FloatArray) -> list[FloatArray]:
    """World tool poses (4, 4) of all waypoints, from the tool's pose ``start`` (4, 4), after checking the waypoints.

    Raises :class:`RobotError`, naming the first waypoint that can't be executed, and why.
    """
    if not trajectory.waypoints:
        raise RobotError("The trajectory has no waypoints.")
    known = {thing.id for thing in scene.objects}
    for index, waypoint in enumerate(trajectory):
        problem = _problem(waypoint, known)
        if problem:
            raise RobotError(f"Waypoint {index} ('{waypoint.stage}'): {problem}")
    try:
        poses = trajectory.poses(start)
    except ValueError as error:
        raise RobotError(f"A waypoint's orientation can't be resolved: {error}") from error
    for index, pose in enumerate(poses):
        if not np.isfinite(pose).all():
            raise RobotError(
                f"Waypoint {index} ('{trajectory.waypoints[index].stage}'): no orientation results."
            )
    return poses


def _problem(waypoint: Waypoint, known: set[str]) -> str:
    numbers = [
        *waypoint.xyz,
        waypoint.gripper,
        waypoint.speed,
        waypoint.tolerance,
        waypoint.dwell,
        waypoint.orientation.angle,
    ]
    numbers += [*waypoint.orientation.vector, *waypoint.orientation.closing]
    if not np.isfinite(numbers).all():
        return "it has numbers that are not finite."
    if waypoint.orientation.policy in ("axis", "twist", "grasp", "slerp") and not any(
        waypoint.orientation.vector
    ):
        return f"the orientation policy '{waypoint.orientation.policy}' needs a vector that is not zero."
    if waypoint.frame != "world":
        return f"its frame is '{waypoint.frame}'; only 'world' can be executed."
    if not 0.0 <= waypoint.gripper <= 1.0:
        return f"its gripper opening {waypoint.gripper} is outside [0, 1]."
    if waypoint.speed <= 0 or waypoint.tolerance <= 0:
        return "its speed and tolerance must be above zero."
    if waypoint.dwell < 0:
        return f"its dwell is {waypoint.dwell:g} s, below zero."
    if waypoint.guard is not None and not waypoint.guard.sound:
        return f"its guard {waypoint.guard} needs a force or a stall above zero, both finite."
    if waypoint.carries and waypoint.carries not in known:
        return f"it carries '{waypoint.carries}', which is not in the scene; there are {sorted(known)}."
    return ""


def check_samples(
    samples: FloatArray,
    dt: float,
    measured: FloatArray,
    limits: tuple[FloatArray, FloatArray],
    velocity: FloatArray,
    start_gap: float = 0.05,
) -> None:
    """Raise :class:`RobotError` unless joint samples (T, dof), one every ``dt`` seconds, may be sent.

    They must be finite, inside ``limits`` (dof,), start within ``start_gap`` radians of the ``measured`` joints
    (dof,), and never move faster than ``velocity`` (dof,) rad/s.
    """
    samples = np.asarray(samples, dtype=np.float64)
    if samples.ndim != 2 or samples.shape[1] != len(measured) or not len(samples):
        raise RobotError(f"Joint samples must be (T, {len(measured)}), got {samples.shape}.")
    if not np.isfinite(samples).all() or not np.isfinite(measured).all():
        raise RobotError("Joint samples or measured joints are not finite.")
    low, high = limits
    outside = np.maximum(low - samples, samples - high).max(axis=0)
    if outside.max() > 1e-6:
        joint = int(outside.argmax())
        raise RobotError(f"Joint {joint + 1} would leave its limits by {outside[joint]:.3f} rad.")
    gap = float(np.abs(samples[0] - measured).max())
    if gap > start_gap:
        raise RobotError(f"The motion starts {gap:.3f} rad from where the arm is; {start_gap} is allowed.")
    if len(samples) > 1:
        ratio = (np.abs(np.diff(samples, axis=0)) / (velocity * dt)).max(axis=0)
        if ratio.max() > 1.05:
            joint = int(ratio.argmax())
            raise RobotError(f"Joint {joint + 1} would jump at {ratio[joint]:.1f} times its speed limit.")
