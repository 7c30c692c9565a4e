"""Hydra configuration: presets and choices; the dataclasses in the code are the schema."""
