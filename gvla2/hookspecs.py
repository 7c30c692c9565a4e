"""Every extension point of gvla2: one hook for each kind of component, and three others.

A plugin is a module (or any object) with functions marked ``@hookimpl``, named after a hook. It is announced by an
entry point of the group ``gvla2``, or passed to :func:`gvla2.register` in a notebook or a test. Each hook *collects*:
it takes no arguments, and the results of all plugins are concatenated. A kind's hook returns components: a name, a
dataclass of options, and a factory that is called only when the component was chosen. The name becomes a choice of the
kind's Hydra group: ``gvla2 run planner=mine``. :data:`gvla2.plugins.kinds.KINDS` is the table of kinds.

    observe -> perceive -> reconstruct -> recall -> plan -> check -> execute -> verify -> learn
    robot      perceiver   reconstructor  memory    planner  (core)   robot     verifier  memory

The order is pluggy's. Of two components of one kind and name the one that is called first wins: ``tryfirst=True``
comes before all others, then what was registered in this process, then gvla2's own plugins, then others by distribution
and name, last ``trylast=True``. Hooks have no wrappers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, get_args, get_type_hints

from gvla2.component import hookspec

if TYPE_CHECKING:
    from gvla2.agents.contracts import Agent
    from gvla2.component import Component
    from gvla2.language.contracts import LanguageModel
    from gvla2.memory.contracts import Embedder, Inducer, Judge, Memory, Retriever, Verifier
    from gvla2.planning.contracts import Perceiver, Planner
    from gvla2.planning.skill import Skill
    from gvla2.plugins.kinds import Kind
    from gvla2.reconstruction.contracts import (
        AxisCompensation,
        FusionStrategy,
        GeometryPrior,
        Reconstructor,
        Renderer,
    )
    from gvla2.record.tracker import Tracker, Viewer
    from gvla2.robot.backend import DepthCamera, RobotBackend
    from gvla2.robot.policy import Policy
    from gvla2.robot.task import Task


@hookspec
def gvla2_robots() -> Iterable[Component[RobotBackend]]:
    """Return robot backends, simulated or real: cameras, motion, execution. Hydra group ``robot``."""


@hookspec
def gvla2_cameras() -> Iterable[Component[DepthCamera]]:
    """Return depth cameras for robots without cameras of their own: live or replayed. Hydra group ``camera``."""


@hookspec
def gvla2_tasks() -> Iterable[Component[Task]]:
    """Return tasks: what lies on the table, what is asked, when it is done. Hydra group ``task``."""


@hookspec
def gvla2_perceivers() -> Iterable[Component[Perceiver]]:
    """Return perceivers: RGB-D views to a labelled 3D scene. Hydra group ``perceiver``."""


@hookspec
def gvla2_reconstructors() -> Iterable[Component[Reconstructor]]:
    """Return reconstructors: masked views to a first geometry of the object. Hydra group ``reconstructor``."""


@hookspec
def gvla2_geometry_priors() -> Iterable[Component[GeometryPrior]]:
    """Return geometry priors: depth for the views from outside knowledge. Hydra group ``prior``."""


@hookspec
def gvla2_axis_compensations() -> Iterable[Component[AxisCompensation]]:
    """Return axis compensations: a scale for each axis and a shift, from masks alone. Hydra group ``axis``."""


@hookspec
def gvla2_fusion_strategies() -> Iterable[Component[FusionStrategy]]:
    """Return fusion strategies: two geometries into one. Hydra group ``fusion``."""


@hookspec
def gvla2_renderers() -> Iterable[Component[Renderer]]:
    """Return renderers of Gaussians. Hydra group ``renderer``."""


@hookspec
def gvla2_memories() -> Iterable[Component[Memory]]:
    """Return whole memory methods: recall and learn. Hydra group ``memory``."""


@hookspec
def gvla2_retrievers() -> Iterable[Component[Retriever]]:
    """Return retrievers: rank records for a task, or abstain. Hydra group ``retriever``."""


@hookspec
def gvla2_embedders() -> Iterable[Component[Embedder]]:
    """Return embedders: texts to unit vectors. Hydra group ``embedder``."""


@hookspec
def gvla2_inducers() -> Iterable[Component[Inducer]]:
    """Return inducers: an episode and its verdict to candidate lessons. Hydra group ``inducer``."""


@hookspec
def gvla2_judges() -> Iterable[Component[Judge]]:
    """Return judges: whether two lessons contradict each other. Hydra group ``judge``."""


@hookspec
def gvla2_planners() -> Iterable[Component[Planner]]:
    """Return planners: instruction, scene and advice to waypoints. Hydra group ``planner``."""


@hookspec
def gvla2_policies() -> Iterable[Component[Policy]]:
    """Return policies: pictures to joint targets, in closed loop instead of a plan. Hydra group ``policy``."""


@hookspec
def gvla2_verifiers() -> Iterable[Component[Verifier]]:
    """Return verifiers: a verdict on an episode from its evidence. Hydra group ``verifier``."""


@hookspec
def gvla2_agents() -> Iterable[Component[Agent]]:
    """Return software agents that work at a shell in a sandbox. Hydra group ``agent``."""


@hookspec
def gvla2_trackers() -> Iterable[Component[Tracker]]:
    """Return trackers: experiment-tracking services that log a run. Hydra group ``tracker``."""


@hookspec
def gvla2_views() -> Iterable[Component[Viewer]]:
    """Return views: files that show an episode in an external 3D viewer. Hydra group ``view``."""


@hookspec
def gvla2_language_models() -> Iterable[Component[LanguageModel]]:
    """Return language models for components that say ``needs=("language",)``. Hydra group ``language``."""


@hookspec
def gvla2_skills() -> Iterable[Skill]:
    """Return skills that every planner may call: all that are offered, by name, without a Hydra group."""


@hookspec
def gvla2_kinds() -> Iterable[Kind]:
    """Return kinds of components that this plugin adds to those of :data:`gvla2.plugins.kinds.KINDS`.

    Each has a hook and a Hydra group of its own, may be chosen in every ``gvla2 run``, and is built where another
    component ``needs`` it.
    """


@hookspec
def gvla2_config_search_path() -> Iterable[str]:
    """Return Hydra search paths with YAML presets of this plugin, such as ``pkg://mine.conf``."""


KINDS_HOOK = gvla2_kinds.__name__
SEARCH_PATH_HOOK = gvla2_config_search_path.__name__
SKILL_HOOK = gvla2_skills.__name__


def protocol_of(hook: Callable[[], object]) -> type:
    """The protocol of what a hook's components build. Imports the packages that declare the protocols."""
    from gvla2.agents import contracts as agents
    from gvla2.component import Component
    from gvla2.language import contracts as language
    from gvla2.memory import contracts as memory
    from gvla2.planning import contracts as planning
    from gvla2.reconstruction import contracts as reconstruction
    from gvla2.record import tracker
    from gvla2.robot import backend, policy, task

    modules = (agents, language, memory, planning, reconstruction, tracker, backend, policy, task)
    names = {name: value for module in modules for name, value in vars(module).items()}
    returned = get_type_hints(hook, localns={**names, "Component": Component, "Iterable": Iterable})["return"]
    (component,) = get_args(returned)
    (protocol,) = get_args(component)
    return protocol  # type: ignore[no-any-return]
