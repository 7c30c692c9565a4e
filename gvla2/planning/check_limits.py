"""The limits that the checks before motion apply to a trajectory: metres, radians, m/s."""

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
