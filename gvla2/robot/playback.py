"""Joint targets sent straight to a simulated arm: from a recording, or live from a policy."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from gvla2.geometry.transform import FloatArray
from gvla2.robot.driver import DriverState


@runtime_checkable
class Playback(Protocol):
    """A simulated robot that can be sent through joint targets, without planning or checks."""

    def play(self, joints: FloatArray, widths: FloatArray, dt: float) -> FloatArray:
        """Measured joints (T, dof) after each of the targets ``joints`` (T, dof), radians, ``dt`` seconds apart.

        The arm begins at rest at the first of them, over an empty table; ``widths`` (T,) are targets between the
        fingers, metres. Raises :class:`gvla2.errors.RobotError` for samples that don't fit the arm.
        """
        ...


@runtime_checkable
class Servo(Protocol):
    """A simulated robot that follows a policy's joint targets among the task's things, without planning or checks."""

    def servo(self, joints: FloatArray, opening: float, seconds: float) -> DriverState:
        """The measurement after driving for ``seconds`` (0 only measures), without waiting for the arm to arrive.

        The arm's targets move evenly to ``joints`` (dof,), radians, within its limits; the fingers' are immediately at
        ``opening`` in [0, 1]. Raises :class:`gvla2.errors.RobotError` for joints that don't fit the arm, and when the
        simulation has blown up.
        """
        ...
