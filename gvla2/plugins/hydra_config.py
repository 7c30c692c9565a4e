"""Components as choices of Hydra groups, and the presets of plugins.

Hydra keeps its configurations and plugins in process-wide stores of its own. This module alone fills them.
"""

from __future__ import annotations

import copy
import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, make_dataclass
from typing import Any, ClassVar

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigLoadError, ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from gvla2.component import Component, ComponentConfig
from gvla2.plugins.kinds import KINDS, NONE, OWN_TASK, SLOTS
from gvla2.plugins.manager import structured
from gvla2.plugins.registry import Registry, load_plugins

PROVIDER = "gvla2"
SWEEP_CALLBACK = "gvla2.commands.sweeps.SweepFolder"
"""Hydra's callback about sweeps: the choice ``hydra/callbacks=gvla2``."""
LONGEST_FOLDER_NAME = 80
_ROBOT_TASKS = "robot_tasks"
"""The last place where Hydra looks for a task: any name that may be the robot's own."""

_NOTHING = Component(NONE, ComponentConfig, lambda config: None)
"""The empty choice of a kind or a slot."""


class PresetSearchPath(SearchPathPlugin):
    """Adds the search paths that plugins announced; Hydra makes instances itself, hence the class attribute."""

    paths: ClassVar[Sequence[str]] = ()

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Called by Hydra before it composes."""
        search_path.append(provider=PROVIDER, path=f"{PROVIDER}://")
        for path in self.paths:
            search_path.append(provider=PROVIDER, path=path)
        search_path.append(provider=PROVIDER, path=f"{PROVIDER}://{_ROBOT_TASKS}")


class ComponentSource(ConfigSource):
    """Where Hydra finds components, each typed when it is asked for: a run composes 20 of 100.

    Hydra makes instances itself and sends them to launchers' worker processes, which find the plugins on their own.
    """

    offered: ClassVar[Mapping[str, Mapping[str, Component[Any]]] | None] = None

    @staticmethod
    def scheme() -> str:
        """The search path ``gvla2://``."""
        return PROVIDER

    def available(self) -> bool:
        """Always."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether this is a kind or a slot, or "", which holds them."""
        return config_path.strip("/") in ("", *self._there())

    def is_config(self, config_path: str) -> bool:
        """Whether this is a component, ``planner/skill`` or ``planner/skill.yaml``."""
        return self._component(config_path) is not None

    def load_config(self, config_path: str) -> ConfigResult:
        """A component's options; raises :class:`ConfigLoadError` where there is none."""
        component = self._component(config_path)
        if component is None:
            raise ConfigLoadError(f"No component {config_path}")
        node = copy.deepcopy(structured(component))  # Hydra changes it
        for name in map(str, node):
            if OmegaConf.get_type(node, name) is dict:  # the user's keys: robot.hand={max_width: 0.08}
                OmegaConf.set_struct(node[name], False)
        return ConfigResult(PROVIDER, f"{PROVIDER}://", node, {"package": None})

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """The components of a group, or the groups."""
        path = config_path.strip("/")
        if self.path == _ROBOT_TASKS:
            return []
        wanted = ObjectType.CONFIG if path else ObjectType.GROUP
        found = self._there().get(path, {}) if path else self._there()
        return sorted(found) if results_filter in (None, wanted) else []

    def _component(self, config_path: str) -> Component[Any] | None:
        if self.path == _ROBOT_TASKS:  # whether the robot offers it turns out when that is built
            group, _, name = config_path.strip("/").partition("/")
            if group != "task" or OWN_TASK not in name:
                return None
            return Component(name.removesuffix(".yaml"), ComponentConfig, lambda config: None)
        group, _, name = config_path.strip("/").rpartition("/")
        return self._there().get(group, {}).get(name.removesuffix(".yaml"))

    @classmethod
    def _there(cls) -> Mapping[str, Mapping[str, Component[Any]]]:
        if cls.offered is None:
            cls.offered = _choosable(load_plugins())
        return cls.offered


class EveryKind:
    """Marks a primary configuration that chooses a component of every kind: it gets a field per group, and defaults."""


def register(
    registry: Registry, schemas: Mapping[str, type] | None = None, groups: Iterable[str] | None = None
) -> None:
    """Offer every component of the registry to Hydra as ``group=kind``, ``name=component.name``, also in the slots.

    ``schemas`` are dataclasses of primary configurations, stored under ``<name>_schema``; one of :class:`EveryKind` has
    its default choices under ``<name>_choices``; one named ``group/name`` is stored in that group, for the whole
    configuration. What an earlier call offered is replaced. ``groups`` are those that the command knows, all by
    default.
    """
    store = ConfigStore.instance()
    _forget(store.repo)
    ComponentSource.offered = _choosable(registry, groups)
    for name, schema in (schemas or {}).items():
        node = schema
        if issubclass(schema, EveryKind):
            node = with_groups(schema, registry.groups)
            store.store(name=f"{name}_choices", node={"defaults": _choices(registry)}, provider=PROVIDER)
        group, _, own = name.rpartition("/")
        place = {"group": group, "package": "_global_"} if group else {}
        store.store(name=own if group else f"{own}_schema", node=node, provider=PROVIDER, **place)
    callback = {"sweep": {"_target_": SWEEP_CALLBACK}}
    store.store(group="hydra/callbacks", name="gvla2", node=callback, provider=PROVIDER)
    PresetSearchPath.paths = registry.search_paths
    Plugins.instance().register(PresetSearchPath)
    Plugins.instance().register(ComponentSource)
    register_resolvers()


def _choosable(
    registry: Registry, groups: Iterable[str] | None = None
) -> Mapping[str, Mapping[str, Component[Any]]]:
    """Components by name of these groups, by default all; also one that is nothing, where it may be left empty."""
    empty = {name for name, kind in registry.groups.items() if name in SLOTS or kind.may_be_none}
    return {
        name: {**({NONE: _NOTHING} if name in empty else {}), **registry.components(name)}
        for name in (registry.groups if groups is None else groups)
    }


def with_groups(schema: type, groups: Iterable[str]) -> type:
    """The dataclass with one more field for each group, which holds the chosen component's options."""
    fields = [(name, ComponentConfig, field(default_factory=ComponentConfig)) for name in groups]
    return make_dataclass(schema.__name__, fields, bases=(schema,), namespace={"__doc__": schema.__doc__})


def _choices(registry: Registry) -> list[dict[str, str | None]]:
    """Hydra's list of defaults; a kind that a plugin declares chooses nothing where its default is not offered."""
    chosen: dict[str, str | None] = dict.fromkeys(SLOTS, NONE)
    for kind in registry.kinds.values():
        there = kind.name in KINDS or kind.default in (NONE, *registry.components(kind.name))
        chosen[kind.name] = kind.default if there else None
    return [{group: name} for group, name in chosen.items()]


def _forget(stored: dict[str, Any]) -> None:
    """Take out of Hydra's store what an earlier call offered."""
    for name, node in list(stored.items()):
        if getattr(node, "provider", None) == PROVIDER:
            del stored[name]
        elif isinstance(node, dict):
            _forget(node)


def register_resolvers() -> None:
    """Make ``${gvla2_short:...}`` known to OmegaConf in this process; a worker process needs it too."""
    OmegaConf.register_new_resolver("gvla2_short", short_name, replace=True)


def short_name(text: str) -> str:
    """A folder name of at most 80 characters for overrides of any length; a cut one ends in a digest."""
    clean = re.sub(r"[^\w=,.+-]+", "-", text).strip("-")
    if len(clean) <= LONGEST_FOLDER_NAME:
        return clean
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return f"{clean[: LONGEST_FOLDER_NAME - 9]}-{digest}"
