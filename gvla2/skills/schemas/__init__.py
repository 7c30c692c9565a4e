"""Motion schemas, one file each: from objects and theta to proposed trajectories."""
