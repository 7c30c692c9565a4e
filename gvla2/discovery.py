"""Finding plugins: entry points are loaded one by one, and each step of each is guarded.

Nothing a plugin does wrong raises here. It becomes a :class:`Problem`, which `gvla2 plugins` shows, and a run
that does not need the plugin goes on.
"""

from __future__ import annotations

import contextlib
import inspect
import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

import pluggy

from gvla2 import hookspecs
from gvla2.kinds import HOOKS, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.markers import PROJECT

DISABLE_VARIABLE = "GVLA2_DISABLE_PLUGINS"
"""Environment variable with names of plugins to skip, separated by commas; ``*`` skips all."""

OWN_PLUGINS = "gvla2_plugins"
"""The package of gvla2's own plugins, one folder each. They are announced like anybody else's."""

_KNOWN_HOOKS = (*HOOKS, SEARCH_PATH_HOOK, SKILL_HOOK)


@dataclass(frozen=True)
class Plugin:
    """One entry point of the group ``gvla2``: its name, and the distribution it comes from."""

    name: str
    distribution: str = ""
    version: str = ""

    @property
    def origin(self) -> str:
        """Distribution and version, as a person writes them."""
        return f"{self.distribution} {self.version}".strip()


@dataclass(frozen=True)
class Problem:
    """What is wrong with a plugin. ``hook`` is "" when the plugin could not be loaded at all."""

    plugin: str
    hook: str
    message: str


@dataclass(frozen=True)
class Offering:
    """What one hook of one plugin returned, not yet looked at."""

    plugin: Plugin
    hook: str
    items: tuple[object, ...]


def discover(found: Iterable[EntryPoint] | None = None) -> tuple[list[Plugin], list[Offering], list[Problem]]:
    """Load every plugin that is not disabled and call its hooks.

    The order decides who wins a duplicate name: gvla2's own plugins first, then by distribution, then by name.
    Returns the plugins that loaded, what their hooks returned, and everything that went wrong.
    """
    points = sorted(
        entry_points(group=PROJECT) if found is None else found,
        key=lambda p: (_distribution(p)[0] != PROJECT, _distribution(p)[0], p.name),
    )
    disabled = {name.strip() for name in os.environ.get(DISABLE_VARIABLE, "").split(",") if name.strip()}
    problems = list(_unknown_disabled(disabled, {p.name for p in points}))
    plugins: list[Plugin] = []
    offerings: list[Offering] = []
    for point in points:
        if point.name in disabled or "*" in disabled:
            continue
        plugin = Plugin(point.name, *_distribution(point))
        try:
            with _stdout_kept_clean():
                module = point.load()
        except (Exception, SystemExit) as error:
            problems.append(Problem(plugin.name, "", f"could not be loaded: {describe(error)}"))
            continue
        plugins.append(plugin)
        for hook, function in _implementations(plugin, module, problems):
            try:
                with _stdout_kept_clean():
                    items = tuple(function())
            except (Exception, SystemExit) as error:
                problems.append(Problem(plugin.name, hook, f"failed: {describe(error)}"))
            else:
                offerings.append(Offering(plugin, hook, items))
    return plugins, offerings, problems


def unannounced() -> list[EntryPoint]:
    """Entry points as they would be for the folders of gvla2's own plugins that the installation does not announce."""
    spec = find_spec(OWN_PLUGINS)
    announced = {point.value for point in entry_points(group=PROJECT)}
    return [
        EntryPoint(module.name, f"{OWN_PLUGINS}.{module.name}", PROJECT)
        for module in iter_modules(spec.submodule_search_locations if spec else [])
        if module.ispkg and f"{OWN_PLUGINS}.{module.name}" not in announced
    ]


def describe(error: BaseException) -> str:
    """An error in one line: its type, its words and, for a mistake in the source, where it is."""
    text = " ".join(str(error).split()) or "no message"
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        text = f"{error.msg} ({error.filename}, line {error.lineno})"
    return f"{type(error).__name__}: {text}"


def closest(word: str, known: Iterable[str]) -> str:
    """The sentence " Did you mean 'x'?" for the nearest known word, or ""."""
    close = get_close_matches(word, list(known), n=1)
    return f" Did you mean '{close[0]}'?" if close else ""


def name_of(module: object) -> str:
    """A module's name, or another object's type."""
    return module.__name__ if isinstance(module, ModuleType) else f"a {type(module).__name__}"


def _implementations(plugin: Plugin, module: object, problems: list[Problem]) -> Iterator[tuple[str, Any]]:
    """The module's hook functions by hook; what looks like one but is not becomes a problem."""
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(hookspecs)
    any_hook = False
    for name in dir(module):
        try:
            options = manager.parse_hookimpl_opts(module, name)
            value = getattr(module, name)
        except Exception:  # a lazy attribute that fails is not a hook
            continue
        hook = (options and options.get("specname")) or name
        if options is None:
            if name.startswith(f"{PROJECT}_") and _own_function(module, value):
                any_hook = True
                hint = "is not marked @hookimpl" if name in _KNOWN_HOOKS else "is no hook of gvla2"
                problems.append(Problem(plugin.name, name, f"{hint}.{_hint(name)}"))
        elif hook not in _KNOWN_HOOKS:
            any_hook = True
            problems.append(Problem(plugin.name, hook, f"is no hook of gvla2.{_hint(hook)}"))
        else:
            any_hook = True
            try:
                inspect.signature(value).bind()
            except TypeError:
                problems.append(Problem(plugin.name, hook, "must take no arguments."))
            else:
                yield hook, value
    if not any_hook:
        problems.append(
            Problem(plugin.name, "", f"offers nothing: {name_of(module)} has no @hookimpl function.")
        )


def _hint(name: str) -> str:
    return "" if name in _KNOWN_HOOKS else closest(name, _KNOWN_HOOKS)


def _own_function(module: object, value: object) -> bool:
    """Whether the function was written there: one imported from the hook specifications is not meant as a hook."""
    if not inspect.isroutine(value) or hasattr(value, f"{PROJECT}_spec"):
        return False
    return not isinstance(module, ModuleType) or getattr(value, "__module__", None) == module.__name__


def _unknown_disabled(disabled: set[str], names: set[str]) -> Iterator[Problem]:
    for name in sorted(disabled - names - {"*"}):
        yield Problem(name, DISABLE_VARIABLE, f"is not installed, so not disabled.{closest(name, names)}")


def _distribution(point: EntryPoint) -> tuple[str, str]:
    return (point.dist.name, point.dist.version) if point.dist else ("", "")


def _stdout_kept_clean() -> contextlib.AbstractContextManager[object]:
    """What a plugin prints while loading goes to stderr: stdout may be somebody's JSON."""
    return contextlib.redirect_stdout(sys.stderr)
