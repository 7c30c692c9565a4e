"""Solving an episode by its own script, from true state: the proof that this arm can do a task.

A demonstration runs through the real executor, so its proof covers planned motions too. It tests tasks and physics,
never planners: it cannot be reached from :mod:`gvla2.episode`.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from gvla2.errors import ConfigurationError
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.backend import ExecutionListener, RobotBackend
from gvla2.robot.report import ExecutionReport
from gvla2.robot.task import TaskInstance, WorldState

_SILENT = ExecutionListener()


@runtime_checkable
class Truthful(Protocol):
    """A simulated robot that exposes the true state of its world, for demonstrations and the ``oracle`` perceiver."""

    def true_state(self) -> WorldState:
        """The state that a success check may read, live."""
        ...

    def true_scene(self) -> Scene:
        """Every body of the episode as a scene object, its id the body's name."""
        ...


def demonstrate(
    robot: RobotBackend, instance: TaskInstance, listener: ExecutionListener = _SILENT
) -> tuple[ExecutionReport, ...]:
    """Carry out the episode's scripted solution; returns the reports of its stretches, up to the first abort.

    Raises :class:`ConfigurationError` when the episode has none or the robot does not expose its true state.
    """
    if instance.solution is None:
        raise ConfigurationError("This task comes without a demonstration.")
    if not isinstance(robot, Truthful):
        raise ConfigurationError(
            f"The robot {type(robot).__name__} does not expose the true state of its world."
        )
    reports = []
    for waypoints in instance.solution(robot.true_state(), robot.arm):
        reports.append(robot.execute(Trajectory(tuple(waypoints)), robot.true_scene(), listener))
        if reports[-1].abort is not None:
            break
    return tuple(reports)
