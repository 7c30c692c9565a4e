"""The staged schemas, one file a way to move: from objects and theta to proposed trajectories."""
