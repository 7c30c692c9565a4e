"""The findings of the checks before motion: typed and complete."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

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
        return {
            "passed": self.passed,
            "repairs": list(self.repairs),
            "findings": [asdict(f) for f in self.findings],
        }
