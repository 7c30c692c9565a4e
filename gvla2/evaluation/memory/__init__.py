"""What the memory wing is measured by: speed, durability, faults, attacks, upkeep; each beside a plain peer."""
