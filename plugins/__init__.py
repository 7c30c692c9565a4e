"""Reference plugins: they come through the same door as anybody else's, one entry point that names them all."""

from pkgutil import iter_modules

PLUGINS = tuple(f"{__name__}.{module.name}" for module in iter_modules(__path__) if module.ispkg)
"""Each folder is a plugin of its own, loaded and guarded by itself."""
