"""Finding plugins: entry points and what was registered in this process, loaded one by one.

Nothing a plugin does wrong raises here. It becomes a :class:`PluginProblem`, which `gvla2 plugins` shows, and a run
that does not need the plugin goes on.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

from gvla2.component import PROJECT, registered
from gvla2.errors import did_you_mean

DISABLE_VARIABLE = "GVLA2_DISABLE_PLUGINS"
"""Environment variable with the names of plugins to skip, separated by commas; ``*`` skips all."""

MODULES = "PLUGINS"
"""A module named by an entry point may list others by full name here; each is a plugin of its own."""


@dataclass(frozen=True)
class Plugin:
    """One plugin: its name, and the distribution it comes from ("" for one registered in this process)."""

    name: str
    distribution: str = ""
    version: str = ""

    @property
    def origin(self) -> str:
        """Distribution and version, for display."""
        return f"{self.distribution} {self.version}".strip()


@dataclass(frozen=True)
class PluginProblem:
    """A fault of a plugin. ``hook`` is "" when the plugin could not be loaded at all."""

    plugin: str
    hook: str
    message: str


def discover(problems: list[PluginProblem]) -> Iterator[tuple[Plugin, object]]:
    """Every plugin that is enabled and loads, in the order in which their hooks are called.

    That order decides who wins a duplicate name: what was registered in this process, the latest first, then gvla2's
    own plugins, then others by distribution and name. What goes wrong is added to ``problems``.
    """
    disabled = {name.strip() for name in os.environ.get(DISABLE_VARIABLE, "").split(",")} - {""}
    seen: set[str] = set()

    def enabled(name: str) -> bool:
        seen.add(name)
        return not disabled & {name, "*"}

    for name, plugin in reversed(registered().items()):
        if enabled(name):
            yield Plugin(name), plugin
    for point in sorted(entry_points(group=PROJECT), key=_order):
        loaded = _load(point.name, point, problems) if enabled(point.name) else None
        if loaded is None:
            continue
        plugin = Plugin(point.name, *_distribution(point))
        modules = getattr(loaded, MODULES, None)
        if modules is None:
            yield plugin, loaded
        for module in modules or ():
            name = str(module).rpartition(".")[2]
            if enabled(name) and (loaded := _load(name, str(module), problems)) is not None:
                yield Plugin(name, plugin.distribution, plugin.version), loaded
    for name in sorted(disabled - seen - {"*"}):
        message = f"is not installed, so not disabled.{did_you_mean(name, seen)}"
        problems.append(PluginProblem(name, DISABLE_VARIABLE, message))


def _order(point: EntryPoint) -> tuple[bool, str, str]:
    distribution = _distribution(point)[0]
    return distribution != PROJECT, distribution, point.name


def _distribution(point: EntryPoint) -> tuple[str, str]:
    return (point.dist.name, point.dist.version) if point.dist else ("", "")


def _load(name: str, target: str | EntryPoint, problems: list[PluginProblem]) -> object | None:
    try:
        with stdout_kept_clean():
            loaded: object = import_module(target) if isinstance(target, str) else target.load()
    except (Exception, SystemExit) as error:
        problems.append(PluginProblem(name, "", f"could not be loaded: {describe(error)}"))
        return None
    return loaded


def describe(error: BaseException) -> str:
    """An error in one line: its type, its message and, for a syntax error, its location."""
    text = " ".join(str(error).split()) or "no message"
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        text = f"{error.msg} ({error.filename}, line {error.lineno})"
    return f"{type(error).__name__}: {text}"


def stdout_kept_clean() -> contextlib.AbstractContextManager[object]:
    """Send a plugin's prints while it loads to stderr: stdout may be somebody's JSON."""
    return contextlib.redirect_stdout(sys.stderr)
