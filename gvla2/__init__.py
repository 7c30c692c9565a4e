"""gvla2: geometry-aware, memory-guided robot planning, every part a plugin.

``import gvla2`` stays light: it loads no numerical library.
The extension points are in :mod:`gvla2.hookspecs`; the loop that uses them is in :mod:`gvla2.episode`.
"""

from gvla2.component import Component, ComponentConfig, hookimpl, register, unregister
from gvla2.errors import Gvla2Error

__version__ = "0.1.0"

__all__ = ["Component", "ComponentConfig", "Gvla2Error", "__version__", "hookimpl", "register", "unregister"]
