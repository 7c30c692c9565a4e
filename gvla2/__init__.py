"""gvla2: geometry-aware, memory-guided robot planning, every part a plugin.

``import gvla2`` stays light: it loads no numerical library.
The extension points are in :mod:`gvla2.hookspecs`; the loop that uses them is in :mod:`gvla2.episode`.
"""

from gvla2.component import Component, ComponentConfig
from gvla2.errors import Gvla2Error
from gvla2.markers import hookimpl
from gvla2.registering import register, unregister

__version__ = "0.1.0"

__all__ = ["Component", "ComponentConfig", "Gvla2Error", "__version__", "hookimpl", "register", "unregister"]
