"""The kinds of components: which hook offers them, which protocol they follow."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from types import MappingProxyType
from typing import Any

from gvla2.errors import ConfigurationError

SEARCH_PATH_HOOK = "gvla2_config_search_path"
SKILL_HOOK = "gvla2_skills"
"""Skills are a table, not one choice of several: all that are offered can be called, so they are no kind."""


@dataclass(frozen=True)
class Kind:
    """One extension point. ``name`` is the word for it and its Hydra group; ``protocol`` is ``module:class``."""

    name: str
    hook: str
    protocol: str

    def members(self) -> tuple[tuple[str, bool], ...]:
        """What the protocol asks of an object: names, and whether each is a method. Imports the wing."""
        module, _, name = self.protocol.partition(":")
        protocol: Any = getattr(import_module(module), name)
        return tuple(
            (member, not isinstance(value, property))
            for member, value in vars(protocol).items()
            if not member.startswith("_") and (inspect.isfunction(value) or isinstance(value, property))
        )

    def missing(self, made: object) -> list[str]:
        """Names that the protocol asks for and ``made`` lacks. Properties are looked up, not evaluated."""
        absent = object()
        lacking = []
        for member, is_method in self.members():
            found = inspect.getattr_static(made, member, absent)
            if is_method or found is absent:  # a wrapper may answer through __getattr__
                found = getattr(made, member, absent)
            if found is absent or (is_method and not callable(found)):
                lacking.append(f"{member}()" if is_method else member)
        return lacking


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            Kind("robot", "gvla2_robots", "gvla2.robot.backend:RobotBackend"),
            Kind("camera", "gvla2_cameras", "gvla2.robot.camera:Camera"),
            Kind("task", "gvla2_tasks", "gvla2.robot.task:Task"),
            Kind("perceiver", "gvla2_perceivers", "gvla2.planning.contracts:Perceiver"),
            Kind("reconstructor", "gvla2_reconstructors", "gvla2.reconstruction.contracts:Reconstructor"),
            Kind("prior", "gvla2_geometry_priors", "gvla2.reconstruction.contracts:GeometryPrior"),
            Kind("axis", "gvla2_axis_compensations", "gvla2.reconstruction.contracts:AxisCompensation"),
            Kind("fusion", "gvla2_fusion_strategies", "gvla2.reconstruction.contracts:FusionStrategy"),
            Kind("renderer", "gvla2_renderers", "gvla2.reconstruction.contracts:Renderer"),
            Kind("memory", "gvla2_memories", "gvla2.memory.contracts:Memory"),
            Kind("retriever", "gvla2_retrievers", "gvla2.memory.contracts:Retriever"),
            Kind("embedder", "gvla2_embedders", "gvla2.memory.contracts:Embedder"),
            Kind("inducer", "gvla2_inducers", "gvla2.memory.contracts:Inducer"),
            Kind("judge", "gvla2_judges", "gvla2.memory.contracts:Judge"),
            Kind("planner", "gvla2_planners", "gvla2.planning.contracts:Planner"),
            Kind("verifier", "gvla2_verifiers", "gvla2.memory.contracts:Verifier"),
            Kind("agent", "gvla2_agents", "gvla2.agents.contracts:Agent"),
            Kind("language", "gvla2_language_models", "gvla2.language.endpoint:LanguageModel"),
        )
    }
)
"""All kinds by name, in the order of an episode; last the model that others may ask."""

SLOTS: Mapping[str, str] = MappingProxyType({"fallback": "planner"})
"""Hydra groups that choose once more among the components of a kind, or ``none`` of them: the slot and its kind."""

HOOKS: Mapping[str, Kind] = MappingProxyType({kind.hook: kind for kind in KINDS.values()})
"""The kinds by hook; hooks without a kind are :data:`SEARCH_PATH_HOOK` and :data:`SKILL_HOOK`."""


def kind_of(name: str) -> Kind:
    """The kind of that name; raises :class:`ConfigurationError` with the names that exist."""
    if name in KINDS:
        return KINDS[name]
    close = get_close_matches(name, KINDS, n=1)
    hint = f" Did you mean '{close[0]}'?" if close else ""
    raise ConfigurationError(f"No kind of component is called '{name}'.{hint} Kinds: {', '.join(KINDS)}.")


def chosen_kinds(config: Mapping[Any, Any]) -> list[str]:
    """The kinds that a composed configuration chooses a component for; a group may share a kind's word."""
    return [kind for kind in KINDS if kind in config and "name" in config[kind]]
