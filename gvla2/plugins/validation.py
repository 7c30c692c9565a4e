"""Checks of what hooks return: each function says in a sentence what is wrong with an item, or ""."""

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
    """What is wrong with an item that the hook returned; options of gvla2's ``own`` are typed when they are used."""
    if hook == SEARCH_PATH_HOOK:
        return _fault_of_path(item)
    if hook == SKILL_HOOK:
        from gvla2.planning.skill import fault_of

        return fault_of(item)
    if hook == KINDS_HOOK:
        return "" if isinstance(item, Kind) else f"returned {item!r}, which is not a Kind."
    return _fault_of_component(item, kinds, own)


def fault_of_kind(kind: Kind, kinds: Mapping[str, Kind]) -> str:
    """What is wrong with a new kind, given the existing ones."""
    hooks = {other.hook for other in kinds.values()} | {KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK}
    if kind.name in kinds or kind.name in SLOTS:
        return f"there is a kind '{kind.name}' already. Rename this one."
    if not _NAME.fullmatch(str(kind.name)) or kind.name.lower() in _WORDS_OF_HYDRA | TAKEN:
        return f"the kind's name {kind.name!r} cannot be a Hydra group of `gvla2 run`: it is taken or not a plain word."
    if (
        not str(kind.hook).startswith(f"{PROJECT}_")
        or not str(kind.hook).isidentifier()
        or kind.hook in hooks
    ):
        return f"'{kind.name}' has the hook {kind.hook!r}; it needs one of its own that begins with '{PROJECT}_'."
    module, colon, name = str(kind.protocol).partition(":")
    if not (module and colon and name.isidentifier()):
        return f"'{kind.name}' has the protocol {kind.protocol!r}; write it as 'module:Class'."
    return ""


def _fault_of_component(item: object, kinds: Mapping[str, Kind], own: bool) -> str:
    if not isinstance(item, Component):
        return f"returned {item!r}, which is not a Component."
    name: Any = item.name  # the first check of what a plugin passes
    build: Any = item.build
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name.lower() in _WORDS_OF_HYDRA:
        return f"the name {name!r} cannot be chosen on the command line; use letters, digits, '_' and '-'."
    if not callable(build):
        return f"'{name}' has a build that cannot be called."
    unknown = [need for need in item.needs if need not in kinds]
    if unknown:
        return f"'{name}' needs {unknown[0]!r}, which is not a kind. Kinds: {', '.join(kinds)}."
    fault = "" if own else _fault_of_config(item)
    return f"'{name}' cannot be configured: {fault}" if fault else ""


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


def _fault_of_path(item: object) -> str:
    if not isinstance(item, str) or not item.startswith(("pkg://", "file://")):
        return f"returned {item!r}; a search path is a string such as 'pkg://mine.conf' or 'file:///presets'."
    if item.startswith("pkg://"):
        package = item.removeprefix("pkg://").replace("/", ".")
        try:
            exists = find_spec(package) is not None
        except (ImportError, ValueError):
            exists = False
        if not exists:
            return f"the package of the search path '{item}' cannot be found."
    return ""
