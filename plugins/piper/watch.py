"""The reasons to stop, checked in every tick of the control loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper import frames
from gvla2_plugins.piper.feedback import Snapshot


@dataclass(frozen=True)
class WatchLimits:
    """Seconds and radians beyond which the arm is held.

    ``tracking`` is how far a joint may be from its target for ``tracking_ticks`` ticks in a row; ``heartbeat`` how long
    the controlling program may be silent, ``lateness`` how late a tick of the loop itself may be. Measurements that
    stay the same to the last digit for ``frozen`` seconds, while a target travels by more than ``frozen_travel``
    radians, count as frozen.
    """

    stale: float = 0.1
    stale_status: float = 0.25
    stale_drives: float = 1.0
    tracking: float = 0.10
    tracking_ticks: int = 5
    heartbeat: float = 0.25
    lateness: float = 0.1
    frozen: float = 0.15
    frozen_travel: float = 0.03


class Watch:
    """Judges snapshots; remembers for how long a joint has been off its target, and the last change measured."""

    def __init__(self, limits: WatchLimits) -> None:
        self.limits = limits
        self._off = 0
        self._same: tuple[float, FloatArray, FloatArray] | None = None  # since when, joints, target then

    def trouble(
        self, seen: Snapshot, target: FloatArray, reader_ok: bool, sending: str, asleep: float = 0.0
    ) -> str:
        """Why the arm must be held now, in words; "" when all is well.

        ``sending`` describes a failed command. ``asleep`` are seconds for which this process itself could not listen
        lately (a long call into a library): feedback may be older by that much.
        """
        limits = self.limits
        if seen.foreign:
            return f"another program commands the arm: frame {seen.foreign}"
        if sending:
            return sending
        if seen.joint_age > limits.stale + asleep:
            return f"no joint feedback for {1e3 * seen.joint_age:.0f} ms"
        if seen.status_age > limits.stale_status + asleep:
            return f"no status for {1e3 * seen.status_age:.0f} ms"
        if seen.drive_age > limits.stale_drives + asleep:
            return f"no word from a drive for {seen.drive_age:.1f} s"
        if not reader_ok and not asleep:
            return "the SDK's reader receives nothing"
        if seen.unbelievable:
            return f"the measurements can't be believed: {seen.unbelievable}"
        return self.condition(seen) or self._tracking(seen, target) or self._frozen(seen, target)

    @staticmethod
    def condition(seen: Snapshot, armed: bool = True) -> str:
        """The arm's own fault reports; an unarmed one may be disabled and in standby."""
        if seen.state != 0:
            return f"the arm's status is '{frames.ARM_STATES.get(seen.state, hex(seen.state))}'"
        if seen.error_code:
            return f"the arm's error code is {seen.error_code:#06x}"
        if seen.faults:
            return f"a drive reports a fault: {', '.join(seen.faults)}"
        if seen.teaching or seen.control not in (0, frames.CAN_CONTROL):
            return f"the arm is in another mode (control {seen.control:#04x}, teaching {seen.teaching:#04x})"
        if armed and seen.control != frames.CAN_CONTROL:
            return "the arm has left CAN control"
        if armed and not all(seen.enabled):
            off = [str(i + 1) for i, on in enumerate(seen.enabled) if not on]
            return f"the motors of joints {', '.join(off)} are off"
        return ""

    def _tracking(self, seen: Snapshot, target: FloatArray) -> str:
        assert seen.joints is not None
        error = np.abs(seen.joints - target)
        worst = int(error.argmax())
        self._off = self._off + 1 if error[worst] > self.limits.tracking else 0
        if self._off < self.limits.tracking_ticks:
            return ""
        return (
            f"joint {worst + 1} is {error[worst]:.2f} rad from its target: stuck, pushed or frozen feedback"
        )

    def _frozen(self, seen: Snapshot, target: FloatArray) -> str:
        assert seen.joints is not None
        if self._same is None or not np.array_equal(self._same[1], seen.joints):
            self._same = (seen.time, seen.joints, target.copy())
        since, _, then = self._same
        travel = float(np.abs(target - then).max())
        if seen.time - since <= self.limits.frozen or travel <= self.limits.frozen_travel:
            return ""
        return f"the feedback is frozen: no digit has changed while the target travelled by {travel:.2f} rad"

    def forget(self) -> None:
        """A new target was set on purpose."""
        self._off, self._same = 0, None
