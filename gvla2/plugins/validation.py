"""Checks of what plugins offer: components and kinds that could not be chosen on the command line are reported."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

from omegaconf import DictConfig, OmegaConf

from gvla2.component import PROJECT, Component, ComponentConfig
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.plugins.discovery import describe
from gvla2.plugins.kinds import SLOTS, TAKEN, Kind

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_WORDS_OF_HYDRA = frozenset({"null", "true", "false", "nan", "inf"})


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
        return _fault_of_path(item)
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
    unknown = [need for need in item.needs if need not in kinds]
    if unknown:
        return f"'{item.name}' needs {unknown[0]!r}, which is not a kind. Kinds: {', '.join(kinds)}."
    fault = "" if own else _fault_of_config(item)
    return f"'{item.name}' cannot be configured: {fault}" if fault else ""


def fault_of_kind(kind: Kind, kinds: Mapping[str, Kind]) -> str:
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


def _fault_of_path(path: object) -> str:
    if not isinstance(path, str) or not path.startswith(("pkg://", "file://")):
        return f"returned {path!r}; a search path is a string such as 'pkg://mine.conf' or 'file:///presets'."
    try:
        exists = find_spec(path.removeprefix("pkg://").replace("/", ".")) if path[:3] == "pkg" else path
    except (ImportError, ValueError):
        exists = None
    return "" if exists else f"the package of the search path '{path}' cannot be found."
