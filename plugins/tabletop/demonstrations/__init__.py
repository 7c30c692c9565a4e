"""How each task can be done, by hand and from true state: proofs of the tasks, out of every planner's sight."""
