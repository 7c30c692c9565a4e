"""pluggy's manager for gvla2's hooks, with every call of a plugin guarded.

:func:`collect` registers the plugins with one :class:`pluggy.PluginManager` and calls each hook once, by pluggy's rules
of order and wrapping. pluggy lets the first error end a call; so what it registers is a guarded twin of each plugin,
whose functions return nothing instead and record a :class:`~gvla2.plugins.discovery.PluginProblem`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import pluggy
from pluggy import HookimplOpts

from gvla2 import hookspecs
from gvla2.component import PROJECT
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK, specifications
from gvla2.plugins.discovery import Plugin, PluginProblem, closest, describe, stdout_kept_clean
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
    """Register the plugins, to be called in this order, and call every hook, or those of the kinds that ``groups``
    choose from, and of what these need.
    """
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(hookspecs)
    manager.add_hookspecs(specifications())
    loaded = list(found)
    guard = _Guard(manager, problems, dict(KINDS))
    unmarked: list[tuple[Plugin, str]] = []
    for plugin, module in reversed(loaded):  # pluggy calls the latest first
        # Two distributions may announce plugins of the same name; pluggy needs unique names.
        name = plugin.name if not manager.has_plugin(plugin.name) else f"{plugin.name} #{len(guard.names)}"
        guard.names[name] = plugin
        twin = guard.twin(plugin, module, unmarked)
        if vars(twin):  # to pluggy two empty ones are equal
            manager.register(twin, name=name)
    for kind, plugin in guard.call(KINDS_HOOK):
        if fault := fault_of_kind(kind, guard.kinds):
            problems.append(PluginProblem(plugin.name, KINDS_HOOK, fault))
            continue
        guard.kinds[kind.name] = kind
        manager.add_hookspecs(specifications([kind]))
    guard.tell_unknown_hooks(unmarked)
    wanted = list(guard.kinds) if groups is None else list(dict.fromkeys(SLOTS.get(g, g) for g in groups))
    components: dict[str, list[tuple[Any, Plugin]]] = {}
    for name in wanted:  # grows by what is needed
        components[name] = guard.call(guard.kinds[name].hook)
        needed = {need for item, _ in components[name] for need in item.needs}
        wanted += sorted(needed.difference(wanted))
    return Collected(
        manager,
        guard.kinds,
        [plugin for plugin, _ in loaded],
        components,
        guard.call(SKILL_HOOK),
        [path for path, _ in guard.call(SEARCH_PATH_HOOK)],
    )


@dataclass
class _Guard:
    """Makes guarded twins, and remembers which plugin each item came from."""

    manager: pluggy.PluginManager
    problems: list[PluginProblem]
    kinds: dict[str, Kind]
    names: dict[str, Plugin] = field(default_factory=dict)
    _sources: dict[int, Plugin] = field(default_factory=dict)
    _returned: list[object] = field(default_factory=list)  # kept alive, so that ids stay theirs

    def twin(self, plugin: Plugin, module: object, unmarked: list[tuple[Plugin, str]]) -> SimpleNamespace:
        """An object with the hook functions of the module, guarded; ``unmarked`` collects likely unmarked hooks."""
        twin = SimpleNamespace()
        before = len(self.problems) + len(unmarked)
        for name in dir(module):
            try:
                options = self.manager.parse_hookimpl_opts(module, name)
                value = getattr(module, name)
            except Exception:  # a lazy attribute that fails is not a hook
                continue
            if options is None:
                if name.startswith(f"{PROJECT}_") and _own_function(module, value):
                    unmarked.append((plugin, name))
                continue
            hook = options.get("specname") or name
            if fault := _fault_of_function(value, options):
                self.problems.append(PluginProblem(plugin.name, hook, fault))
            else:
                setattr(twin, name, self._guarded(plugin, hook, value, options))
        if not vars(twin) and len(self.problems) + len(unmarked) == before:
            self.problems.append(
                PluginProblem(
                    plugin.name, "", f"offers nothing: {_name_of(module)} has no @hookimpl function."
                )
            )
        return twin

    def _guarded(
        self, plugin: Plugin, hook: str, function: Callable[[], Any], options: HookimplOpts
    ) -> Callable[[], Any]:
        wraps = options["wrapper"] or options["hookwrapper"]
        if wraps:

            def wrapper() -> Generator[None, Any, Any]:
                return (yield from self._wrap(plugin, hook, function, old=options["hookwrapper"]))

            guarded: Callable[[], Any] = wrapper
        else:

            def implementation() -> list[object]:
                return self._answer(plugin, hook, function)

            guarded = implementation
        setattr(guarded, _MARK, {**options, "wrapper": wraps, "hookwrapper": False})
        return guarded

    def _answer(self, plugin: Plugin, hook: str, function: Callable[[], Any]) -> list[object]:
        """What one plugin returns, without invalid items."""
        try:
            with stdout_kept_clean():
                answer: object = function()
                items = list(answer) if isinstance(answer, Iterable) else None
        except (Exception, SystemExit) as error:
            self.problems.append(PluginProblem(plugin.name, hook, f"failed: {describe(error)}"))
            return []
        if items is None:
            self.problems.append(PluginProblem(plugin.name, hook, f"returned {answer!r:.80}, not a list."))
        return self._fit(plugin, hook, items or ())

    def _wrap(
        self, plugin: Plugin, hook: str, function: Callable[[], Any], *, old: bool
    ) -> Generator[None, Any, Any]:
        """Run a wrapper round the others; where it fails, what they returned stands."""

        def failed(why: str) -> None:
            self.problems.append(PluginProblem(plugin.name, hook, f"failed: {why}"))

        generator = function()
        try:
            with stdout_kept_clean():
                next(generator)
        except StopIteration:
            failed("it wraps nothing: it never reaches a yield.")
            return (yield)
        except (Exception, SystemExit) as error:
            failed(describe(error))
            return (yield)
        inner = yield
        outcome = pluggy.Result(inner, None) if old else inner
        try:
            with stdout_kept_clean():
                generator.send(outcome)
        except StopIteration as stop:
            answer = outcome.get_result() if old else stop.value
        except (Exception, SystemExit) as error:
            failed(describe(error))
            return inner
        else:
            failed("it yields a second time.")
            return inner
        try:
            groups = [list(group) for group in answer]
        except TypeError:
            failed(f"a wrapper returns the list of what each plugin returned, not {answer!r:.80}.")
            return inner
        return [self._fit(plugin, hook, group) for group in groups]

    def _fit(self, plugin: Plugin, hook: str, items: Iterable[object]) -> list[object]:
        kept = []
        for item in items:
            if fault := fault_of_item(item, hook, self.kinds, own=plugin.distribution == PROJECT):
                self.problems.append(PluginProblem(plugin.name, hook, fault))
                continue
            self._sources.setdefault(id(item), plugin)
            self._returned.append(item)
            kept.append(item)
        return kept

    def call(self, hook: str) -> list[tuple[Any, Plugin]]:
        """What all plugins return, each item with the plugin that made it."""
        groups = getattr(self.manager.hook, hook)()
        return [(item, self._sources[id(item)]) for group in groups for item in group]

    def tell_unknown_hooks(self, unmarked: list[tuple[Plugin, str]]) -> None:
        """Report functions that look like hooks but are not."""
        known = [name for name, caller in vars(self.manager.hook).items() if _is_specified(caller)]
        for plugin, name in unmarked:
            hint = (
                "is not marked @hookimpl." if name in known else f"is no hook of gvla2.{closest(name, known)}"
            )
            self.problems.append(PluginProblem(plugin.name, name, hint))
        for name, caller in vars(self.manager.hook).items():
            if isinstance(caller, pluggy.HookCaller) and not caller.has_spec():
                for made in caller.get_hookimpls():
                    if not made.optionalhook:
                        message = f"is no hook of gvla2.{closest(name, known)}"
                        self.problems.append(PluginProblem(self.names[made.plugin_name].name, name, message))


def _is_specified(caller: object) -> bool:
    return isinstance(caller, pluggy.HookCaller) and caller.has_spec()


def _fault_of_function(function: Any, options: HookimplOpts) -> str:
    """Why pluggy could not call this as a hook, or ""."""
    try:
        inspect.signature(function).bind()
    except TypeError:
        return "must take no arguments."
    if (options["wrapper"] or options["hookwrapper"]) and not inspect.isgeneratorfunction(function):
        return "is a wrapper without a yield."
    return ""


def _name_of(module: object) -> str:
    return module.__name__ if isinstance(module, ModuleType) else f"a {type(module).__name__}"


def _own_function(module: object, value: object) -> bool:
    """Whether the function was written there: one imported from the hook specifications is not meant as a hook."""
    if not inspect.isroutine(value) or hasattr(value, f"{PROJECT}_spec"):
        return False
    return not isinstance(module, ModuleType) or getattr(value, "__module__", None) == module.__name__
