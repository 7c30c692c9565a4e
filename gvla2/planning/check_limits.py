"""The limits that the checks before motion apply to a trajectory."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CheckLimits:
    """Limits in metres, radians, m/s.

    * ``table_margin``: gap between the fingertips' end and the table, where touching it is not allowed.
    * ``max_linear``, ``max_free``: longest straight and longest planned move. A straight line through half the
      workspace soon meets a joint limit; more than the workspace's diagonal is an error.
    * ``max_speed`` of the tool.
    * ``limit_margin`` to each joint's limit; ``joint_jump``: largest joint step between two samples (1 cm) of a
      straight move, beyond it the arm would flip; ``min_manipulability``: share of the arm's best, 0 at a singularity.
    * ``free_clearance`` where a planned move starts and ends, so that the motion planner has room to leave and arrive;
      ``linear_clearance`` along straight moves.
    * ``sweep_step``: spacing of clearance samples along a straight move.
    """

    table_margin: float = 0.003
    max_linear: float = 0.6
    max_free: float = 1.6
    max_speed: float = 1.0
    limit_margin: float = 0.02
    joint_jump: float = 0.35
    min_manipulability: float = 0.032
    free_clearance: float = 0.005
    linear_clearance: float = 0.001
    sweep_step: float = 0.02


DEFAULT_LIMITS = CheckLimits()
