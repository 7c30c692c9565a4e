"""The robot suite: what success there is, and how much of it memory is worth, measured without favour."""
