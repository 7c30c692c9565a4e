"""Measurements of the memory wing: speed, durability, faults, attacks, upkeep; each beside a plain peer."""
