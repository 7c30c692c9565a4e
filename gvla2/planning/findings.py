"""The findings of the checks before motion: typed and complete."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from gvla2.planning.check_limits import EPS
from gvla2.planning.trajectory import Trajectory

CheckName = Literal["schema", "workspace", "gripper", "kinematics", "clearance", "memory"]
"""The six checks, in the order they run."""


@dataclass(frozen=True)
class Finding:
    """One thing a check measured at one waypoint (``index`` -1: the whole trajectory).

    ``kind`` is a stable word ("too_few_waypoints", "outside_workspace", "unreachable", "collision", ...); "" with
    ``passed`` for a check that found nothing wrong. ``value`` against ``limit`` in SI units, if numeric.
    """

    check: CheckName
    passed: bool
    index: int = -1
    kind: str = ""
    message: str = ""
    value: float | None = None
    limit: float | None = None


class Findings:
    """What one check found wrong with a trajectory so far; messages begin with the waypoint's index and stage."""

    def __init__(self, check: CheckName, trajectory: Trajectory) -> None:
        self._check, self._trajectory = check, trajectory
        self._failed: list[Finding] = []

    def fail(
        self, index: int, kind: str, message: str, value: float | None = None, limit: float | None = None
    ) -> None:
        """Add a fault of waypoint ``index``, of the whole trajectory if it is negative."""
        if index >= 0:
            stage = self._trajectory.waypoints[index].stage
            message = f"Waypoint {index} ({stage or 'no stage'}): {message}"
        self._failed.append(Finding(self._check, False, index, kind, message, value, limit))

    def least(self, index: int, kind: str, what: str, value: float, limit: float, advice: str) -> bool:
        """Whether a value is at least its limit; a fault if not. ``what`` names the value and its unit in brackets."""
        if value < limit - EPS:
            self.fail(index, kind, f"{what} is {value:.3g}, below {limit:.3g}; {advice}.", value, limit)
        return value >= limit - EPS

    def most(self, index: int, kind: str, what: str, value: float, limit: float, advice: str) -> bool:
        """As :meth:`least`, for a value that must not be above its limit."""
        if value > limit + EPS:
            self.fail(index, kind, f"{what} is {value:.3g}, above {limit:.3g}; {advice}.", value, limit)
        return value <= limit + EPS

    def or_passed(self, message: str) -> list[Finding]:
        """All faults, or the one finding of a check that found none."""
        return self._failed or [Finding(self._check, True, message=message)]


@dataclass(frozen=True)
class CheckReport:
    """All findings of all six checks, and the changes of a repair before them (plain sentences)."""

    findings: tuple[Finding, ...] = ()
    repairs: tuple[str, ...] = ()

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
