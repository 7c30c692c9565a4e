"""Reference plugins: loaded like any third party's, through one entry point that names them all."""

from pkgutil import iter_modules

PLUGINS = tuple(f"{__name__}.{module.name}" for module in iter_modules(__path__) if module.ispkg)
"""Each folder is a separate plugin, loaded and guarded on its own."""
