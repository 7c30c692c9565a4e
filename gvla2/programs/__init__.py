"""Answers of language planners (calls of skills, waypoints, array expressions): parsed and validated."""
