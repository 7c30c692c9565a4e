"""What a robot's verifier judges: scenes before and after, the plan, and the execution's report."""

from __future__ import annotations

from dataclasses import dataclass

from gvla2.memory.contracts import Evidence
from gvla2.planning.contracts import Plan
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import Scene
from gvla2.robot.report import ExecutionReport


@dataclass(frozen=True, kw_only=True)
class RobotEvidence(Evidence):
    """Evidence of one episode, as the robot itself could gather it: perceived scenes, never true state.

    ``after`` is None when nothing could be perceived at the end. ``gripper_width`` at the end, metres.
    """

    before: Scene
    after: Scene | None
    plan: Plan
    checks: CheckReport
    report: ExecutionReport
    gripper_width: float
