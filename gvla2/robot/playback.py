"""Playing joint targets that were recorded elsewhere on a simulated arm."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from gvla2.geometry.transform import FloatArray


@runtime_checkable
class Playback(Protocol):
    """A simulated robot that can be sent through joint targets, without planning or checks."""

    def play(self, joints: FloatArray, widths: FloatArray, dt: float) -> FloatArray:
        """Measured joints (T, dof) after each of the targets ``joints`` (T, dof), radians, ``dt`` seconds apart.

        The arm begins at rest at the first of them, over an empty table; ``widths`` (T,) are targets between the
        fingers, metres. Raises :class:`gvla2.errors.RobotError` for samples that don't fit the arm.
        """
        ...
