"""Calls the plugins' hooks in pluggy's order and checks their answers: a faulty plugin never ends a call."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import Any

import pluggy
from omegaconf import DictConfig, OmegaConf

from gvla2 import hookspecs
from gvla2.component import PROJECT, Component, ComponentConfig, hookspec
from gvla2.errors import did_you_mean
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.plugins.discovery import Plugin, PluginProblem, describe, stdout_kept_clean
from gvla2.plugins.kinds import KINDS, SLOTS, TAKEN, Kind

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_WORDS_OF_HYDRA = frozenset({"null", "true", "false", "nan", "inf"})


@dataclass(frozen=True)
class Collected:
    """All offers of plugins, each item with its plugin, in the order of pluggy's calls."""

    kinds: Mapping[str, Kind]
    plugins: tuple[Plugin, ...]
    components: Mapping[str, list[tuple[Any, Plugin]]]
    skills: list[tuple[Any, Plugin]]
    search_paths: list[str]


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
    skills, paths = list(caller.call(SKILL_HOOK)), [path for path, _ in caller.call(SEARCH_PATH_HOOK)]
    return Collected(caller.kinds, tuple(plugin for plugin, _ in loaded), components, skills, paths)


class _Caller:
    """One :class:`pluggy.PluginManager`, and which plugin each registered name stands for."""

    def __init__(self, problems: list[PluginProblem]) -> None:
        self.kinds: dict[str, Kind] = dict(KINDS)
        self._manager = pluggy.PluginManager(PROJECT)
        self._manager.add_hookspecs(hookspecs)
        self._problems = problems
        self._plugins: dict[str, Plugin] = {}

    def register(self, plugin: Plugin, module: object) -> None:
        """Register the plugin's hook functions; none of them where one could not be called."""
        # Two distributions may announce plugins of the same name; pluggy needs unique names.
        unique = f"{plugin.name} #{len(self._plugins)}"
        self._plugins[unique] = plugin
        try:
            self._manager.register(module, name=unique)
        except Exception as error:  # pluggy's, for a hook with arguments, or a lazy attribute's
            self._report(plugin, "", f"could not be registered: {describe(error)}")
            if self._manager.has_plugin(unique):
                self._manager.unregister(name=unique)
            return
        if not self._manager.get_hookcallers(module):
            what = module.__name__ if isinstance(module, ModuleType) else f"a {type(module).__name__}"
            self._report(plugin, "", f"offers nothing: {what} has no function marked @hookimpl.")

    def add_kind(self, kind: Kind, plugin: Plugin) -> None:
        """Add a plugin's kind and its hook."""
        if fault := _fault_of_kind(kind, self.kinds):
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
        """Report functions that are marked as hooks but are none."""
        callers = {n: c for n, c in vars(self._manager.hook).items() if isinstance(c, pluggy.HookCaller)}
        known = [name for name, caller in callers.items() if caller.has_spec()]
        for name in callers.keys() - known:
            for made in callers[name].get_hookimpls():
                if not made.optionalhook:
                    message = f"is no hook of gvla2.{did_you_mean(name, known)}"
                    self._report(self._plugins[made.plugin_name], name, message)

    def _report(self, plugin: Plugin, hook: str, message: str) -> None:
        self._problems.append(PluginProblem(plugin.name, hook, message))


def structured(component: Component[Any]) -> DictConfig:
    """The component's options as a typed OmegaConf node, with ``name`` filled in; not to be changed."""
    return _structured(component.config, component.name)  # type: ignore[arg-type]  # a class can be hashed


@lru_cache(maxsize=1024)  # by class: hooks make new components whenever plugins are loaded
def _structured(config: type[ComponentConfig], name: str) -> DictConfig:
    node = OmegaConf.structured(config)
    node.name = name
    assert isinstance(node, DictConfig)
    return node


def fault_of_item(item: object, hook: str, kinds: Mapping[str, Kind], own: bool = False) -> str:
    """The fault of an item that the hook returned, "" for none.

    The options of gvla2's ``own`` components are typed when they are used.
    """
    if hook == SEARCH_PATH_HOOK:
        right = isinstance(item, str) and item.startswith(("pkg://", "file://"))
        return "" if right else f"returned {item!r}; a search path is a string such as 'pkg://mine.conf'."
    if hook == SKILL_HOOK:
        from gvla2.planning.skill import fault_of

        return fault_of(item)
    if hook == KINDS_HOOK:
        return "" if isinstance(item, Kind) else f"returned {item!r}, which is not a Kind."
    if not isinstance(item, Component):
        return f"returned {item!r}, which is not a Component."
    if not _choosable(item.name):
        return (
            f"the name {item.name!r} cannot be chosen on the command line; use letters, digits, '_' and '-'."
        )
    build: Any = item.build  # a plugin may pass anything
    if not callable(build):
        return f"'{item.name}' has a build that cannot be called."
    if unknown := [need for need in item.needs if need not in kinds]:
        return f"'{item.name}' needs {unknown[0]!r}, which is not a kind. Kinds: {', '.join(kinds)}."
    fault = "" if own else _fault_of_config(item)
    return f"'{item.name}' cannot be configured: {fault}" if fault else ""


def _fault_of_kind(kind: Kind, kinds: Mapping[str, Kind]) -> str:
    """The fault of a new kind, given the existing ones; "" for none."""
    hooks = {other.hook for other in kinds.values()} | {KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK}
    if kind.name in kinds or kind.name in SLOTS:
        return f"there is a kind '{kind.name}' already. Rename this one."
    if not _choosable(kind.name) or kind.name.lower() in TAKEN:
        return f"the kind's name {kind.name!r} cannot be a Hydra group of `gvla2 run`: it is taken or not a plain word."
    if not kind.hook.startswith(f"{PROJECT}_") or not kind.hook.isidentifier() or kind.hook in hooks:
        return f"'{kind.name}' has the hook {kind.hook!r}; it needs one of its own that begins with '{PROJECT}_'."
    return ""


def _choosable(name: object) -> bool:
    plain = isinstance(name, str) and _NAME.fullmatch(name) is not None
    return plain and str(name).lower() not in _WORDS_OF_HYDRA


def _fault_of_config(component: Component[Any]) -> str:
    config: Any = component.config
    if not (isinstance(config, type) and issubclass(config, ComponentConfig)):
        return f"its config is {config!r}, not a dataclass that extends ComponentConfig."
    if "__dataclass_fields__" not in vars(config) and vars(config).get("__annotations__"):
        return f"{config.__name__} is not marked @dataclass, so its own fields would be ignored."
    try:
        structured(component)
    except Exception as error:  # whatever OmegaConf or a default factory raises
        return f"{config.__name__} does not fit OmegaConf: {describe(error)}"
    return ""
