"""Calling the plugins' hooks in pluggy's order, each implementation guarded: a plugin that fails never ends a call."""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import pluggy

from gvla2 import hookspecs
from gvla2.component import PROJECT, hookspec
from gvla2.errors import did_you_mean
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.plugins.discovery import Plugin, PluginProblem, describe, stdout_kept_clean
from gvla2.plugins.kinds import KINDS, SLOTS, Kind
from gvla2.plugins.validation import fault_of_item, fault_of_kind


@dataclass
class Collected:
    """All offers of plugins, each item with its plugin, in the order of pluggy's calls."""

    kinds: Mapping[str, Kind]
    plugins: list[Plugin] = field(default_factory=list)
    components: dict[str, list[tuple[Any, Plugin]]] = field(default_factory=dict)
    skills: list[tuple[Any, Plugin]] = field(default_factory=list)
    search_paths: list[str] = field(default_factory=list)


def collect(
    found: Iterable[tuple[Plugin, object]],
    problems: list[PluginProblem],
    groups: Collection[str] | None = None,
) -> Collected:
    """Register the plugins, to be called in this order, and call every hook.

    With ``groups`` only the hooks of the kinds that these choose from are called, and those of what these need.
    """
    loaded = list(found)
    caller = _Caller(problems)
    for plugin, module in reversed(loaded):  # pluggy calls the latest first
        caller.register(plugin, module)
    for kind, plugin in caller.call(KINDS_HOOK):
        caller.add_kind(kind, plugin)
    caller.report_unknown_hooks()
    wanted = list(caller.kinds) if groups is None else list(dict.fromkeys(SLOTS.get(g, g) for g in groups))
    components: dict[str, list[tuple[Any, Plugin]]] = {}
    for name in wanted:  # grows by what is needed
        components[name] = list(caller.call(caller.kinds[name].hook))
        needed = {need for item, _ in components[name] for need in item.needs}
        wanted += sorted(needed.difference(wanted))
    return Collected(
        caller.kinds,
        [plugin for plugin, _ in loaded],
        components,
        list(caller.call(SKILL_HOOK)),
        [path for path, _ in caller.call(SEARCH_PATH_HOOK)],
    )


class _Caller:
    """One :class:`pluggy.PluginManager`, and which plugin each registered name stands for."""

    def __init__(self, problems: list[PluginProblem]) -> None:
        self.kinds: dict[str, Kind] = dict(KINDS)
        self._manager = pluggy.PluginManager(PROJECT)
        self._manager.add_hookspecs(hookspecs)
        self._problems = problems
        self._plugins: dict[str, Plugin] = {}
        self._unmarked: list[tuple[Plugin, str]] = []

    def register(self, plugin: Plugin, module: object) -> None:
        """Register the plugin's hook functions, without those that could not be called."""
        functions: dict[str, Any] = {}
        wrong = False
        for name in dir(module):
            try:
                options = self._manager.parse_hookimpl_opts(module, name)
                value = getattr(module, name)
            except Exception:  # a lazy attribute that fails is not a hook
                continue
            if options is None:
                if name.startswith(f"{PROJECT}_") and _written_in(module, value):
                    self._unmarked.append((plugin, name))
                    wrong = True
                continue
            if options["wrapper"] or options["hookwrapper"]:
                fault = "is a wrapper: gvla2's hooks collect, and have none."
            else:
                fault = "" if _takes_nothing(value) else "must take no arguments."
            if fault:
                self._report(plugin, options.get("specname") or name, fault)
                wrong = True
            else:
                functions[name] = value
        if functions:
            # Two distributions may announce plugins of the same name; pluggy needs unique names.
            unique = f"{plugin.name} #{len(self._plugins)}"
            self._plugins[unique] = plugin
            self._manager.register(SimpleNamespace(**functions), name=unique)
        elif not wrong:
            what = module.__name__ if isinstance(module, ModuleType) else f"a {type(module).__name__}"
            self._report(plugin, "", f"offers nothing: {what} has no @hookimpl function.")

    def add_kind(self, kind: Kind, plugin: Plugin) -> None:
        """Add a plugin's kind and its hook."""
        if fault := fault_of_kind(kind, self.kinds):
            self._report(plugin, KINDS_HOOK, fault)
            return
        self.kinds[kind.name] = kind
        specification = ModuleType(kind.name)
        setattr(specification, kind.hook, hookspec(lambda: None))
        self._manager.add_hookspecs(specification)

    def call(self, hook: str) -> Iterator[tuple[Any, Plugin]]:
        """The valid items that all plugins return, each with its plugin."""
        for implementation in reversed(getattr(self._manager.hook, hook).get_hookimpls()):
            plugin = self._plugins[implementation.plugin_name]
            try:
                with stdout_kept_clean():
                    answer: object = implementation.function()
                    items = list(answer) if isinstance(answer, Iterable) else None
            except (Exception, SystemExit) as error:
                self._report(plugin, hook, f"failed: {describe(error)}")
                continue
            if items is None:
                self._report(plugin, hook, f"returned {answer!r:.80}, not a list.")
            for item in items or ():
                if fault := fault_of_item(item, hook, self.kinds, own=plugin.distribution == PROJECT):
                    self._report(plugin, hook, fault)
                else:
                    yield item, plugin

    def report_unknown_hooks(self) -> None:
        """Report functions that look like hooks but are not."""
        callers = {n: c for n, c in vars(self._manager.hook).items() if isinstance(c, pluggy.HookCaller)}
        known = [name for name, caller in callers.items() if caller.has_spec()]
        unknown = [
            (self._plugins[made.plugin_name], name)
            for name, caller in callers.items()
            for made in caller.get_hookimpls()
            if not caller.has_spec() and not made.optionalhook
        ]
        for plugin, name in (*self._unmarked, *unknown):
            unmarked = "is not marked @hookimpl."
            message = unmarked if name in known else f"is no hook of gvla2.{did_you_mean(name, known)}"
            self._report(plugin, name, message)

    def _report(self, plugin: Plugin, hook: str, message: str) -> None:
        self._problems.append(PluginProblem(plugin.name, hook, message))


def _takes_nothing(function: Any) -> bool:
    try:
        inspect.signature(function).bind()
    except TypeError:
        return False
    return True


def _written_in(module: object, value: object) -> bool:
    """Whether the function was written there: one imported from the hook specifications is not meant as a hook."""
    if not inspect.isroutine(value) or hasattr(value, f"{PROJECT}_spec"):
        return False
    return not isinstance(module, ModuleType) or getattr(value, "__module__", None) == module.__name__
