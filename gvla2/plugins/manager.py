"""pluggy's manager for gvla2's hooks; a plugin that fails never ends a call.

:func:`collect` registers the plugins with one :class:`pluggy.PluginManager` and calls each hook once, by pluggy's rules
of order and wrapping. pluggy lets the first error end a call; so what it registers is a guarded twin of each plugin,
whose functions return nothing instead and record a :class:`~gvla2.plugins.discovery.PluginProblem`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import pluggy
from pluggy import HookimplOpts

from gvla2 import hookspecs
from gvla2.component import PROJECT, hookspec
from gvla2.errors import did_you_mean
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.plugins.discovery import Plugin, PluginProblem, describe, stdout_kept_clean
from gvla2.plugins.kinds import KINDS, SLOTS, Kind
from gvla2.plugins.validation import fault_of_item, fault_of_kind

_MARK = f"{PROJECT}_impl"
"""The attribute in which pluggy's marker leaves a function's options."""


@dataclass
class Collected:
    """What plugins offer, each item with its plugin, in the order of pluggy's calls."""

    manager: pluggy.PluginManager
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
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(hookspecs)
    loaded = list(found)
    caller = _Caller(manager, problems, dict(KINDS))
    for plugin, module in reversed(loaded):  # pluggy calls the latest first
        caller.register(plugin, module)
    for kind, plugin in caller.call(KINDS_HOOK):
        if fault := fault_of_kind(kind, caller.kinds):
            problems.append(PluginProblem(plugin.name, KINDS_HOOK, fault))
            continue
        caller.kinds[kind.name] = kind
        specification = ModuleType(kind.hook)
        setattr(specification, kind.hook, hookspec(lambda: None))
        manager.add_hookspecs(specification)
    caller.report_unknown_hooks()
    wanted = list(caller.kinds) if groups is None else list(dict.fromkeys(SLOTS.get(g, g) for g in groups))
    components: dict[str, list[tuple[Any, Plugin]]] = {}
    for name in wanted:  # grows by what is needed
        components[name] = caller.call(caller.kinds[name].hook)
        needed = {need for item, _ in components[name] for need in item.needs}
        wanted += sorted(needed.difference(wanted))
    return Collected(
        manager,
        caller.kinds,
        [plugin for plugin, _ in loaded],
        components,
        caller.call(SKILL_HOOK),
        [path for path, _ in caller.call(SEARCH_PATH_HOOK)],
    )


class _Twin:
    """The functions of a plugin that pluggy calls, as attributes."""


@dataclass
class _Caller:
    """Registers guarded twins of plugins, calls hooks, and remembers which plugin each item came from."""

    manager: pluggy.PluginManager
    problems: list[PluginProblem]
    kinds: dict[str, Kind]
    _plugins: dict[str, Plugin] = field(default_factory=dict)
    _unmarked: list[tuple[Plugin, str]] = field(default_factory=list)
    _sources: dict[int, Plugin] = field(default_factory=dict)
    _returned: list[object] = field(default_factory=list)  # kept alive, so that ids stay theirs

    def register(self, plugin: Plugin, module: object) -> None:
        """Register a twin with the plugin's hook functions, guarded; wrappers go in as they are."""
        twin = _Twin()
        before = len(self.problems) + len(self._unmarked)
        for name in dir(module):
            try:
                options = self.manager.parse_hookimpl_opts(module, name)
                value = getattr(module, name)
            except Exception:  # a lazy attribute that fails is not a hook
                continue
            if options is None:
                if name.startswith(f"{PROJECT}_") and _own_function(module, value):
                    self._unmarked.append((plugin, name))
                continue
            hook = options.get("specname") or name
            if fault := _fault_of_function(value, options):
                self._report(plugin, hook, fault)
            elif _wraps(options):
                setattr(twin, name, value)
            else:
                setattr(twin, name, self._guarded(plugin, hook, value, options))
        if vars(twin):
            # Two distributions may announce plugins of the same name; pluggy needs unique names.
            taken = self.manager.has_plugin(plugin.name)
            unique = f"{plugin.name} #{len(self._plugins)}" if taken else plugin.name
            self._plugins[unique] = plugin
            self.manager.register(twin, name=unique)
        elif len(self.problems) + len(self._unmarked) == before:
            what = module.__name__ if isinstance(module, ModuleType) else f"a {type(module).__name__}"
            self._report(plugin, "", f"offers nothing: {what} has no @hookimpl function.")

    def _report(self, plugin: Plugin, hook: str, message: str) -> None:
        self.problems.append(PluginProblem(plugin.name, hook, message))

    def _guarded(
        self, plugin: Plugin, hook: str, function: Callable[[], Any], options: HookimplOpts
    ) -> Callable[[], list[object]]:
        def implementation() -> list[object]:
            return self._answer(plugin, hook, function)

        setattr(implementation, _MARK, options)
        return implementation

    def _answer(self, plugin: Plugin, hook: str, function: Callable[[], Any]) -> list[object]:
        """What one plugin returns, without invalid items."""
        try:
            with stdout_kept_clean():
                answer: object = function()
                items = list(answer) if isinstance(answer, Iterable) else None
        except (Exception, SystemExit) as error:
            self._report(plugin, hook, f"failed: {describe(error)}")
            return []
        if items is None:
            self._report(plugin, hook, f"returned {answer!r:.80}, not a list.")
        return self._valid(plugin, hook, items or ())

    def _valid(self, plugin: Plugin, hook: str, items: Iterable[object]) -> list[object]:
        kept = []
        for item in items:
            source = self._sources.get(id(item))
            if source is None:
                if fault := fault_of_item(item, hook, self.kinds, own=plugin.distribution == PROJECT):
                    self._report(plugin, hook, fault)
                    continue
                self._sources[id(item)] = plugin
                self._returned.append(item)
            kept.append(item)
        return kept

    def call(self, hook: str) -> list[tuple[Any, Plugin]]:
        """What all plugins return, each item with the plugin that made it; a wrapper that fails is left out."""
        caller = getattr(self.manager.hook, hook)
        wrappers = [made for made in caller.get_hookimpls() if made.wrapper or made.hookwrapper]
        before = len(self.problems)
        try:
            with stdout_kept_clean():
                groups = caller()
            if wrappers:
                outermost = self._plugins[wrappers[-1].plugin_name]
                groups = [self._valid(outermost, hook, group) for group in groups]
        except (Exception, SystemExit) as error:
            del self.problems[before:]  # the second call reports them again
            for made in wrappers:
                self._report(self._plugins[made.plugin_name], hook, f"failed to wrap: {describe(error)}")
            without = [made.plugin for made in wrappers]
            groups = self.manager.subset_hook_caller(hook, remove_plugins=without)()
        return [(item, self._sources[id(item)]) for group in groups for item in group]

    def report_unknown_hooks(self) -> None:
        """Report functions that look like hooks but are not."""
        callers = {n: c for n, c in vars(self.manager.hook).items() if isinstance(c, pluggy.HookCaller)}
        known = [name for name, caller in callers.items() if caller.has_spec()]
        for plugin, name in self._unmarked:
            unknown = f"is no hook of gvla2.{did_you_mean(name, known)}"
            self._report(plugin, name, "is not marked @hookimpl." if name in known else unknown)
        for name, caller in callers.items():
            for made in () if caller.has_spec() else caller.get_hookimpls():
                if not made.optionalhook:
                    message = f"is no hook of gvla2.{did_you_mean(name, known)}"
                    self._report(self._plugins[made.plugin_name], name, message)


def _wraps(options: HookimplOpts) -> bool:
    return options["wrapper"] or options["hookwrapper"]


def _fault_of_function(function: Any, options: HookimplOpts) -> str:
    """Why pluggy could not call this as a hook, or ""."""
    try:
        inspect.signature(function).bind()
    except TypeError:
        return "must take no arguments."
    if _wraps(options) and not inspect.isgeneratorfunction(function):
        return "is a wrapper without a yield."
    return ""


def _own_function(module: object, value: object) -> bool:
    """Whether the function was written there: one imported from the hook specifications is not meant as a hook."""
    if not inspect.isroutine(value) or hasattr(value, f"{PROJECT}_spec"):
        return False
    return not isinstance(module, ModuleType) or getattr(value, "__module__", None) == module.__name__
