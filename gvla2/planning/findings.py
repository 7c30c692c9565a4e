"""Findings of the checks before motion, and the limits that the checks apply."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from gvla2.planning.trajectory import Trajectory, WaypointFault

TABLE_MARGIN = 0.003
"""Gap between the fingertips' end and the table, where touching it is not allowed."""
MAX_LINEAR, MAX_FREE = 0.6, 1.6
"""Longest straight and longest planned move. A straight line through half the workspace soon meets a joint limit; more
than the workspace's diagonal is an error."""
MAX_SPEED = 1.0
"""Of the tool."""
LIMIT_MARGIN = 0.02
"""Distance to each joint's limit."""
JOINT_JUMP = 0.35
"""Largest joint step between two samples (1 cm) of a straight move, beyond which the arm would flip."""
MIN_MANIPULABILITY = 0.032
"""Share of the arm's best, 0 at a singularity."""
FREE_CLEARANCE, LINEAR_CLEARANCE = 0.005, 0.001
"""Where a planned move starts and ends, so that the motion planner has room to leave and arrive; and along straight
moves."""
SWEEP_STEP = 0.02
"""Spacing of clearance samples along a straight move."""
EPS = 1e-6
"""Numbers this close to a limit keep it."""


CheckName = Literal["schema", "workspace", "gripper", "kinematics", "clearance", "memory"]
"""The six checks, in the order they run."""
FindingKind = Literal[
    "",
    "unchecked",
    # schema
    "too_few_waypoints", "too_many_waypoints", "no_stage", "unknown_object", WaypointFault,
    # workspace
    "outside_workspace", "table_margin", "segment_too_long", "too_fast",
    # gripper
    "opening_range", "opens_while_carrying", "not_released", "carries_without_grasp", "grasp_misses",
    "dropped_silently", "closes_on_nothing",
    # kinematics
    "unreachable", "no_straight_line", "joint_limit", "singular", "joint_jump",
    # clearance
    "collision", "blocked_start", "hand_blocked", "too_wide",
    # memory
    "bound_broken",
]  # fmt: skip
"""What a check found, a stable word; "" with ``passed`` for a check that found nothing wrong."""


@dataclass(frozen=True)
class Finding:
    """What one check found at one waypoint (``index`` -1: the whole trajectory).

    ``value`` against ``limit`` in SI units, if numeric.
    """

    check: CheckName
    passed: bool
    index: int = -1
    kind: FindingKind = ""
    message: str = ""
    value: float | None = None
    limit: float | None = None


class Findings:
    """What one check found wrong with a trajectory so far; messages begin with the waypoint's index and stage."""

    def __init__(self, check: CheckName, trajectory: Trajectory) -> None:
        self._check, self.trajectory = check, trajectory
        self._failed: list[Finding] = []

    def fail(
        self,
        index: int,
        kind: FindingKind,
        message: str,
        value: float | None = None,
        limit: float | None = None,
    ) -> None:
        """Add a fault of waypoint ``index``, of the whole trajectory if it is negative."""
        if index >= 0:
            stage = self.trajectory.waypoints[index].stage
            message = f"Waypoint {index} ({stage or 'no stage'}): {message}"
        self._failed.append(Finding(self._check, False, index, kind, message, value, limit))

    def least(
        self, index: int, kind: FindingKind, what: str, value: float, limit: float, advice: str
    ) -> bool:
        """Whether a value is at least its limit; a fault if not. ``what`` names the value and its unit in brackets."""
        if value < limit - EPS:
            self.fail(index, kind, f"{what} is {value:.3g}, below {limit:.3g}; {advice}.", value, limit)
        return value >= limit - EPS

    def most(self, index: int, kind: FindingKind, what: str, value: float, limit: float, advice: str) -> None:
        """A fault if a value is above its limit."""
        if value > limit + EPS:
            self.fail(index, kind, f"{what} is {value:.3g}, above {limit:.3g}; {advice}.", value, limit)

    def or_passed(self, message: str) -> list[Finding]:
        """All faults, or the one finding of a check that found none."""
        return self._failed or [Finding(self._check, True, message=message)]


@dataclass(frozen=True)
class CheckReport:
    """All findings of all six checks."""

    findings: tuple[Finding, ...] = ()

    @property
    def passed(self) -> bool:
        """No finding speaks against the trajectory."""
        return all(f.passed for f in self.findings)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The messages of failed findings, in order."""
        return tuple(f.message for f in self.findings if not f.passed)

    def to_json(self) -> dict[str, Any]:
        """As a JSON object."""
        return {"passed": self.passed, **asdict(self)}
