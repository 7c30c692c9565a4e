"""Scripted solutions of each task from true state: proofs that the tasks are feasible, hidden from planners."""
