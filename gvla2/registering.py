"""Plugins of this process: registered in a notebook or a test, without a distribution or an entry point.

pluggy keeps plugins in a manager; here they wait for the next one (:func:`gvla2.plugins.load_plugins` makes one
whenever a command starts). Worker processes of a sweep know installed plugins only.
"""

from __future__ import annotations

from gvla2.errors import PluginError

_WAITING: dict[str, object] = {}


def register(plugin: object, name: str = "") -> str:
    """Offer what the ``@hookimpl`` functions of a module, class or object return; returns the plugin's name.

    The name is the object's own unless given. An earlier registration of that name is replaced, so that a notebook cell
    can run twice. What is registered is called before installed plugins: its components win.
    """
    own = name or getattr(plugin, "__name__", "") or type(plugin).__name__
    if isinstance(plugin, str) or plugin is None:
        raise PluginError(
            f"gvla2.register takes a module or an object with @hookimpl functions, not {plugin!r}."
        )
    _WAITING.pop(own, None)
    _WAITING[own] = plugin
    return own


def unregister(name: str) -> None:
    """Undo :func:`register` for that name; raises :class:`PluginError` for an unknown one."""
    if name not in _WAITING:
        raise PluginError(f"No plugin '{name}' is registered. Registered: {', '.join(_WAITING) or 'none'}.")
    del _WAITING[name]


def registered() -> dict[str, object]:
    """The plugins registered in this process by name, oldest first."""
    return dict(_WAITING)
