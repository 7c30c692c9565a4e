"""The robot wing: the backend contract, tasks, motion, execution reports, safety."""
