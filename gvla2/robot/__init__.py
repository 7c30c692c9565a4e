"""Robots: the backend contract, tasks, arms, motion planning, execution, calibration."""
