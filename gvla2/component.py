"""For plugin authors: components with options, the marker of hooks, and registration without a distribution."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar, Generic, TypeVar

import pluggy

from gvla2.errors import ConfigurationError, PluginError

PROJECT = "gvla2"
"""Entry-point group and pluggy project name."""

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)
"""The two pluggy markers: ``hookspec`` declares an extension point, ``hookimpl`` fills it."""

Range = tuple[float, float, str]
"""Minimum and maximum of a numeric option, both allowed, and its unit, "" for none."""

_REGISTERED: dict[str, object] = {}
"""Plugins of this process, which have no distribution or entry point. Worker processes know installed ones only."""

T_co = TypeVar("T_co", covariant=True)


@dataclass(kw_only=True)
class ComponentConfig:
    """Base of a component's configuration: each further field is one Hydra option, typed and checked.

    Fields hold what OmegaConf can: numbers, strings, booleans, enums, lists, dicts, nested dataclasses.
    ``required`` names options whose default does not work: a bench over all components leaves such a component out.
    ``name`` is the name that the component was chosen by; the bridge to Hydra fills it in.
    """

    required: ClassVar[tuple[str, ...]] = ()

    name: str = ""


def described(options: ComponentConfig, name: str = "", only: Collection[str] = ()) -> str:
    """A component in a table: its name, or the given one, and the options that differ from their defaults.

    ``only`` these options are looked at, by default all.
    """
    changed = []
    for field in fields(options):
        usual = field.default if field.default_factory is MISSING else field.default_factory()
        value = getattr(options, field.name)
        same = value == usual or (isinstance(usual, tuple) and value == list(usual))  # as composed
        if field.name != "name" and not same and (not only or field.name in only):
            changed.append(f"{field.name}={value}")
    name = name or options.name
    return f"{name} ({', '.join(changed)})" if changed else name


def check_ranges(options: object, kind: str, ranges: Mapping[str, Range]) -> None:
    """Raise :class:`ConfigurationError` for a number outside its range or not-a-number; for ``__post_init__``.

    ``kind`` is the options' place on the command line, "planner"; ``ranges`` may have more than these options.
    """
    for name, value in vars(options).items():
        if name not in ranges:
            continue
        least, most, unit = ranges[name]
        if not least <= value <= most:
            span = f"from {least} to {most} {unit}".rstrip()
            raise ConfigurationError(f"{kind}.{name} is {value}; it must be {span}.")


class Component(Generic[T_co]):
    """One entry of a catalog: chosen by ``name``, configured by ``config``, made by ``build``.

    ``build`` gets an instance of ``config`` and, by keyword, one built component for each kind in
    ``needs`` (for example ``needs=("retriever", "embedder")``). It runs only when the component is
    used, so it is the place to import heavy libraries. ``summary`` is one line for ``gvla2 plugins``;
    without it the first line of ``build``'s docstring serves.
    """

    def __init__(
        self,
        name: str,
        config: type[ComponentConfig],
        build: Callable[..., T_co],
        *,
        summary: str = "",
        needs: Iterable[str] = (),
    ) -> None:
        self.name = name
        self.config = config
        self.build: Callable[..., Any] = build
        self.summary = summary or (inspect.getdoc(build) or "").partition("\n")[0]
        self.needs = tuple(needs)

    def __repr__(self) -> str:
        return f"Component({self.name!r}, {self.config.__name__})"


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
    _REGISTERED.pop(own, None)
    _REGISTERED[own] = plugin
    return own


def unregister(name: str) -> None:
    """Undo :func:`register` for that name; raises :class:`PluginError` for an unknown one."""
    if name not in _REGISTERED:
        raise PluginError(
            f"No plugin '{name}' is registered. Registered: {', '.join(_REGISTERED) or 'none'}."
        )
    del _REGISTERED[name]


def registered() -> dict[str, object]:
    """The plugins registered in this process by name, oldest first."""
    return dict(_REGISTERED)
