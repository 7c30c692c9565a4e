"""Reference plugins: they come through the same entry points as anybody else's."""
