"""The rule that ends a guarded motion: too much force on the hand, or the tool blocked."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.trajectory import Guard
from gvla2.robot.arm_model import ArmModel


class GuardWatch:
    """Watches one motion for a :class:`Guard`; implements :data:`gvla2.robot.driver.StopRule`.

    ``force`` is the largest so far, newtons, None before a measurement. ``reason`` says what ended the motion, ""
    before that.
    """

    def __init__(self, guard: Guard, arm: ArmModel) -> None:
        self.force: float | None = None
        self.reason = ""
        self._guard, self._arm = guard, arm

    def __call__(self, commanded: FloatArray, measured: FloatArray, force: FloatArray | None) -> bool:
        """Whether to end the motion now; joints (dof,), radians, force (3,), newtons."""
        guard = self._guard
        if force is not None:
            felt = float(np.linalg.norm(force))
            self.force = max(felt, self.force or 0.0)
            if 0.0 < guard.force < felt:
                self.reason = f"Stopped on contact: {felt:.1f} N, guarded at {guard.force:g} N."
                return True
        if guard.stall > 0.0:
            aimed, reached = self._arm.tool_positions(np.stack([commanded, measured]))
            lag = float(np.linalg.norm(aimed - reached))
            if lag > guard.stall:
                self.reason = (
                    f"Stopped where the tool was held back by {1e3 * lag:.1f} mm, "
                    f"guarded at {1e3 * guard.stall:g} mm."
                )
                return True
        return False
