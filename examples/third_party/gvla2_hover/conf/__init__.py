"""Presets: `gvla2 run planner=hover_high`."""
