"""The kinds of components, one line each: this table is where a kind is declared.

Hooks (:mod:`gvla2.hookspecs`), Hydra groups, the configuration of ``gvla2 run`` and its default choices
follow from it. A plugin declares further kinds with the hook ``gvla2_kinds``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from gvla2 import hookspecs
from gvla2.errors import ConfigurationError, did_you_mean

NONE = "none"
"""The empty choice, where no component of the kind has that name."""


@dataclass(frozen=True)
class Kind:
    """One extension point; its ``name`` is also its Hydra group.

    ``hook`` returns its components, which are ``what``. ``protocol`` returns what they satisfy (``lambda: Mine``): a
    function, because the core imports its protocols on demand. ``default`` is the choice of ``gvla2 run``. Where
    ``none`` is the default, or the kind is ``optional``, ``none`` may be chosen without a component of that name, and
    what needs the kind then gets None.
    """

    name: str
    hook: str
    protocol: Callable[[], type]
    what: str
    default: str = NONE
    optional: bool = False

    @property
    def may_be_none(self) -> bool:
        """Whether ``none`` may be chosen."""
        return self.optional or self.default == NONE

    def members(self) -> dict[str, bool]:
        """The protocol's members, and whether each is a method."""
        return {
            member: not isinstance(value, property)
            for member, value in vars(self.protocol()).items()
            if not member.startswith("_") and (inspect.isfunction(value) or isinstance(value, property))
        }

    def missing(self, made: object) -> list[str]:
        """Names that the protocol asks for and ``made`` lacks. Properties are looked up, not evaluated."""
        absent = object()
        lacking = []
        for member, is_method in self.members().items():
            found = inspect.getattr_static(made, member, absent)
            if is_method or found is absent:  # an adapter may answer through __getattr__
                found = getattr(made, member, absent)
            if found is absent or (is_method and not callable(found)):
                lacking.append(f"{member}()" if is_method else member)
        return lacking


def _kind(name: str, hook: Callable[[], object], default: str = NONE, *, optional: bool = False) -> Kind:
    """A kind of the core: its hook's first sentence says what it is."""
    what = (inspect.getdoc(hook) or "").partition(". ")[0].removeprefix("Return ")
    return Kind(name, hook.__name__, lambda: hookspecs.protocol_of(hook), what, default, optional)


_CORE = (
    _kind("robot", hookspecs.gvla2_robots, "sapien_panda"),
    _kind("camera", hookspecs.gvla2_cameras),
    _kind("task", hookspecs.gvla2_tasks, "pick_and_lift", optional=True),
    _kind("perceiver", hookspecs.gvla2_perceivers, "classical"),
    _kind("reconstructor", hookspecs.gvla2_reconstructors),
    _kind("prior", hookspecs.gvla2_geometry_priors),
    _kind("axis", hookspecs.gvla2_axis_compensations, "contours"),
    _kind("fusion", hookspecs.gvla2_fusion_strategies, "residual"),
    _kind("renderer", hookspecs.gvla2_renderers, "numba"),
    _kind("memory", hookspecs.gvla2_memories, "governed"),
    _kind("retriever", hookspecs.gvla2_retrievers, "hybrid"),
    _kind("embedder", hookspecs.gvla2_embedders, "auto"),
    _kind("inducer", hookspecs.gvla2_inducers, "rules"),
    _kind("judge", hookspecs.gvla2_judges),
    _kind("planner", hookspecs.gvla2_planners, "skill"),
    _kind("policy", hookspecs.gvla2_policies),
    _kind("verifier", hookspecs.gvla2_verifiers, "geometric"),
    _kind("agent", hookspecs.gvla2_agents),
    _kind("tracker", hookspecs.gvla2_trackers),
    _kind("view", hookspecs.gvla2_views),
    _kind("language", hookspecs.gvla2_language_models, "endpoint"),
)
KINDS: Mapping[str, Kind] = MappingProxyType({kind.name: kind for kind in _CORE})
"""The kinds of the core by name, in the order of an episode, then the language model that others may ask."""

SLOTS: Mapping[str, str] = MappingProxyType({"fallback": "planner"})
"""Hydra groups that choose a second component of a kind, or ``none``: the slot and its kind."""

OWN_TASK = "/"
"""Separator in the name of a task that a robot offers itself, ``suite/task``; names of components have none."""

TAKEN = frozenset(
    {
        *(
            "hydra",
            "instruction",
            "branch",
            "seed",
            "episodes",
            "quiet",
            "record",
            "second_tries",
            "replan",
            "planner_timeout",
        ),
        *("depth_noise", "results"),
    }
)
"""Words of the configuration of ``gvla2 run``, which no kind can use."""


def kind_of(name: str, kinds: Mapping[str, Kind] = KINDS) -> Kind:
    """The kind of that name; raises :class:`ConfigurationError` with the names that exist."""
    if name in kinds:
        return kinds[name]
    hint = did_you_mean(name, kinds)
    raise ConfigurationError(f"No kind of component is called '{name}'.{hint} Kinds: {', '.join(kinds)}.")
