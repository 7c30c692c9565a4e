"""Bounds on commands to a Piper, tighter than the maker's."""

from __future__ import annotations

from dataclasses import dataclass, field

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper.arm import FULL_SPEED

HIGHEST_SPEED_SHARE = 0.20
"""No configuration makes this backend faster than this share of full speed."""

HIGHEST_GRIP_EFFORT = 2.0
"""Nm; the gripper itself goes to 5."""


@dataclass(frozen=True)
class Bounds:
    """The gate's limits: ``speed_share`` of full speed, targets every ``period`` seconds, ``grip_effort`` Nm.

    A joint target is a step of at most ``step`` (6,) radians from the last one, or lies within ``near`` radians of
    where the arm was measured; ``slack`` radians beyond the maker's limits are tolerated, because a parked arm
    measures a little outside of them.
    """

    speed_share: float = 0.2
    grip_effort: float = 1.0
    period: float = 0.01
    near: float = 0.05
    slack: float = 0.05
    step: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        share = min(self.speed_share, HIGHEST_SPEED_SHARE)
        object.__setattr__(self, "speed_share", share)
        object.__setattr__(self, "grip_effort", min(self.grip_effort, HIGHEST_GRIP_EFFORT))
        object.__setattr__(self, "step", 1.25 * share * FULL_SPEED * self.period)

    @property
    def percent(self) -> int:
        """The speed as the mode frame carries it."""
        return max(1, round(100 * self.speed_share))
