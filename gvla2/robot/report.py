"""The report of an execution, waypoint by waypoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

AbortCode = Literal[
    "",
    "unreachable",
    "no_path",
    "tracking",
    "collision",
    "slipped",
    "interrupted",
    "timeout",
    "expired",
    "diverged",
    "not_started",
]


@dataclass(frozen=True)
class WaypointReport:
    """The result of one waypoint. Positions in metres, world frame; times in seconds.

    ``error`` is the distance of the tool from its target; ``contacts`` are the names of the robot's own links that felt
    a contact (never names of scene bodies); ``gripper_width`` in metres; ``held`` says that the fingers stopped on an
    object, None when the robot does not measure it. ``status`` is the motion planner's ("linear", "direct",
    "rrt_connect", "failed"), or "guarded" if the waypoint's guard ended the motion early; ``abort`` is "" when the
    waypoint was carried out. ``motion_seconds`` are the robot's own, the hand's included, as planned for a robot
    without a clock. ``force`` is the largest on the hand in a guarded motion, newtons, None if not measured.
    """

    index: int
    stage: str
    target: tuple[float, float, float]
    reached: tuple[float, float, float]
    error: float
    gripper_width: float
    held: bool | None
    contacts: tuple[str, ...] = ()
    status: str = ""
    abort: AbortCode = ""
    message: str = ""
    planning_seconds: float = 0.0
    motion_seconds: float = 0.0
    force: float | None = None


@dataclass(frozen=True)
class ExecutionReport:
    """All waypoints up to the end or to the first abort. Executed does not mean succeeded: a verifier judges that."""

    waypoints: tuple[WaypointReport, ...] = ()
    seconds: float = 0.0
    joint_path: Sequence[Sequence[float]] = field(default=(), repr=False)

    @property
    def completed(self) -> bool:
        """Every waypoint was carried out."""
        return bool(self.waypoints) and all(not w.abort for w in self.waypoints)

    @property
    def abort(self) -> WaypointReport | None:
        """The waypoint that stopped it, if one did."""
        return next((w for w in self.waypoints if w.abort), None)

    def to_json(self) -> dict[str, Any]:
        """As a JSON object, without the joint path."""
        return {
            "completed": self.completed,
            "seconds": self.seconds,
            "waypoints": [asdict(w) for w in self.waypoints],
        }
