"""The kinds of components, one line each: this table is where a kind is declared.

Hooks (:mod:`gvla2.hookspecs`), Hydra groups (:mod:`gvla2.hydra_bridge`), the configuration of ``gvla2 run`` and its
default choices follow from it. A plugin declares further kinds with the hook ``gvla2_kinds``.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from types import MappingProxyType
from typing import Any

from gvla2.errors import ConfigurationError

NONE = "none"
"""The empty choice, where no component of the kind has that name."""


@dataclass(frozen=True)
class Kind:
    """One extension point. ``name`` is its name and its Hydra group; ``protocol`` is ``module:class``.

    ``hook`` returns its components, which are ``what``. ``default`` is the choice of ``gvla2 run``; ``none`` may be
    chosen without a component of that name, and what needs the kind then gets None.
    """

    name: str
    hook: str
    protocol: str
    what: str
    default: str = NONE

    def members(self) -> tuple[tuple[str, bool], ...]:
        """The protocol's members: names, and whether each is a method. Imports the wing."""
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


def _table(*rows: tuple[str, str, str, str, str]) -> Mapping[str, Kind]:
    return MappingProxyType(
        {
            name: Kind(name, f"gvla2_{hook}", protocol, what, default)
            for name, hook, protocol, what, default in rows
        }
    )


# fmt: off
KINDS: Mapping[str, Kind] = _table(
    ("robot", "robots", "gvla2.robot.backend:RobotBackend",
     "robot backends, simulated or real: cameras, motion, execution", "sapien_panda"),
    ("camera", "cameras", "gvla2.robot.camera:DepthCamera",
     "depth cameras for robots without cameras of their own: live or replayed", "none"),
    ("task", "tasks", "gvla2.robot.task:Task",
     "tasks: what lies on the table, what is asked, when it is done", "pick_and_lift"),
    ("perceiver", "perceivers", "gvla2.planning.contracts:Perceiver",
     "perceivers: RGB-D views to a labelled 3D scene", "classical"),
    ("reconstructor", "reconstructors", "gvla2.reconstruction.contracts:Reconstructor",
     "reconstructors: masked views to the first object G0", "none"),
    ("prior", "geometry_priors", "gvla2.reconstruction.contracts:GeometryPrior",
     "geometry priors: depth for the views from outside knowledge", "none"),
    ("axis", "axis_compensations", "gvla2.reconstruction.contracts:AxisCompensation",
     "axis compensations: a scale an axis and a shift from masks alone", "contours"),
    ("fusion", "fusion_strategies", "gvla2.reconstruction.contracts:FusionStrategy",
     "fusion strategies: two geometries into one", "residual"),
    ("renderer", "renderers", "gvla2.reconstruction.contracts:Renderer",
     "renderers of Gaussians", "numba"),
    ("memory", "memories", "gvla2.memory.contracts:Memory",
     "whole memory methods: recall and learn", "governed"),
    ("retriever", "retrievers", "gvla2.memory.contracts:Retriever",
     "retrievers: rank records for a task, or abstain", "hybrid"),
    ("embedder", "embedders", "gvla2.memory.contracts:Embedder",
     "embedders: texts to unit vectors", "auto"),
    ("inducer", "inducers", "gvla2.memory.contracts:Inducer",
     "inducers: an episode and its verdict to candidate lessons", "rules"),
    ("judge", "judges", "gvla2.memory.contracts:Judge",
     "judges: which similar lessons in words contradict each other", NONE),
    ("planner", "planners", "gvla2.planning.contracts:Planner",
     "planners: instruction, scene and advice to waypoints", "skill"),
    ("verifier", "verifiers", "gvla2.memory.contracts:Verifier",
     "verifiers: judge an episode from its evidence", "geometric"),
    ("agent", "agents", "gvla2.agents.contracts:Agent",
      "software agents that work at a shell in a sandbox", NONE),
    ("tracker", "trackers", "gvla2.record.tracker:Tracker",
     "trackers: experiment-tracking services that log a run", "none"),
    ("view", "views", "gvla2.record.tracker:Viewer",
     "views: files that show an episode in an external 3D viewer", "none"),
    ("language", "language_models", "gvla2.language.endpoint:LanguageModel",
     "language models for components that say needs=(\"language\",)", "endpoint"),
)
# fmt: on
"""The kinds of the core by name, in the order of an episode, then the language model that others may ask."""

SLOTS: Mapping[str, str] = MappingProxyType({"fallback": "planner"})
"""Hydra groups that choose a second component of a kind, or ``none``: the slot and its kind."""

TAKEN = frozenset(
    {
        "hydra",
        "instruction",
        "seed",
        "episodes",
        "quiet",
        "replan",
        "planner_timeout",
        "max_parts",
        "agreement",
        "depth_noise",
        "results",
    }
)
"""Reserved words of the configuration of ``gvla2 run``, which no kind can use."""


def kind_of(name: str, kinds: Mapping[str, Kind] = KINDS) -> Kind:
    """The kind of that name; raises :class:`ConfigurationError` with the names that exist."""
    if name in kinds:
        return kinds[name]
    close = get_close_matches(name, kinds, n=1)
    hint = f" Did you mean '{close[0]}'?" if close else ""
    raise ConfigurationError(f"No kind of component is called '{name}'.{hint} Kinds: {', '.join(kinds)}.")


def chosen_kinds(config: Mapping[Any, Any], kinds: Iterable[str] = KINDS) -> list[str]:
    """The kinds that a composed configuration chooses a component for; a group may share a kind's word."""
    return [kind for kind in kinds if kind in config and "name" in config[kind]]
