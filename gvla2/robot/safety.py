"""Static checks: nothing is sent to an arm that is not finite, inside the limits and continuous."""

from __future__ import annotations

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory


def check_trajectory(trajectory: Trajectory, scene: Scene, start: FloatArray) -> list[FloatArray]:
    """World tool poses (4, 4) of all waypoints, from the tool's pose ``start`` (4, 4), after checking the waypoints.

    Raises :class:`RobotError`, naming the first waypoint that can't be executed, and why.
    """
    if not trajectory.waypoints:
        raise RobotError("The trajectory has no waypoints.")
    known = {thing.id for thing in scene.objects}
    for index, waypoint in enumerate(trajectory):
        faults = [message for _, message in waypoint.faults()]
        if not 0.0 <= waypoint.gripper <= 1.0:
            faults.append(f"its gripper opening {waypoint.gripper} is outside [0, 1].")
        if waypoint.carries and waypoint.carries not in known:
            faults.append(f"it carries '{waypoint.carries}', which is not in the scene.")
        if faults:
            raise RobotError(f"Waypoint {index} ('{waypoint.stage}'): {faults[0]}")
    return trajectory.poses(start)


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
