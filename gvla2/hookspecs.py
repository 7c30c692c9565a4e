"""Every extension point of gvla2, readable alone.

A plugin is a module of functions marked ``@hookimpl``, named after a hook below, and announced by an entry point
of the group ``gvla2``. Each hook returns components: a name, a dataclass of options, and a factory that is called
only when the component was chosen. The name becomes a choice of the hook's Hydra group: ``gvla2 run planner=mine``.

    observe -> perceive -> reconstruct -> recall -> plan -> check -> execute -> verify -> learn
    robot      perceiver   reconstructor  memory    planner  (core)   robot     verifier  memory
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from gvla2.markers import hookspec

if TYPE_CHECKING:
    from gvla2.agents.contracts import Agent
    from gvla2.component import Component
    from gvla2.language.endpoint import LanguageModel
    from gvla2.memory.contracts import Embedder, Inducer, Judge, Memory, Retriever, Verifier
    from gvla2.planning.contracts import Perceiver, Planner
    from gvla2.reconstruction.contracts import (
        AxisCompensation,
        FusionStrategy,
        GeometryPrior,
        Reconstructor,
        Renderer,
    )
    from gvla2.robot.backend import RobotBackend
    from gvla2.robot.camera import Camera
    from gvla2.robot.task import Task
    from gvla2.skills.skill import Skill


@hookspec
def gvla2_robots() -> Iterable[Component[RobotBackend]]:
    """Return robot backends, simulated or real: cameras, motion, execution (Hydra group ``robot``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_cameras() -> Iterable[Component[Camera]]:
    """Return depth cameras for robots without eyes of their own: live or replayed (Hydra group ``camera``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_tasks() -> Iterable[Component[Task]]:
    """Return tasks: what lies on the table, what is asked, when it is done (Hydra group ``task``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_perceivers() -> Iterable[Component[Perceiver]]:
    """Return perceivers: RGB-D views to a labelled 3D scene (Hydra group ``perceiver``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_reconstructors() -> Iterable[Component[Reconstructor]]:
    """Return reconstructors: masked views to the first object G0 (Hydra group ``reconstructor``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_geometry_priors() -> Iterable[Component[GeometryPrior]]:
    """Return geometry priors: depth for the views from outside knowledge (Hydra group ``prior``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_axis_compensations() -> Iterable[Component[AxisCompensation]]:
    """Return axis compensations: a scale an axis and a shift from masks alone (Hydra group ``axis``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_fusion_strategies() -> Iterable[Component[FusionStrategy]]:
    """Return fusion strategies: two geometries into one (Hydra group ``fusion``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_renderers() -> Iterable[Component[Renderer]]:
    """Return renderers of Gaussians (Hydra group ``renderer``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_memories() -> Iterable[Component[Memory]]:
    """Return whole memory methods: recall and learn (Hydra group ``memory``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_retrievers() -> Iterable[Component[Retriever]]:
    """Return retrievers: rank records for a task, or abstain (Hydra group ``retriever``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_embedders() -> Iterable[Component[Embedder]]:
    """Return embedders: texts to unit vectors (Hydra group ``embedder``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_inducers() -> Iterable[Component[Inducer]]:
    """Return inducers: an episode and its verdict to candidate lessons (Hydra group ``inducer``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_judges() -> Iterable[Component[Judge]]:
    """Return judges: which of the lessons that are suspected of it contradict each other (Hydra group ``judge``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_planners() -> Iterable[Component[Planner]]:
    """Return planners: instruction, scene and advice to waypoints (Hydra group ``planner``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_skills() -> Iterable[Skill]:
    """Return skills that every planner may call: all that are offered, by name (no Hydra group)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_verifiers() -> Iterable[Component[Verifier]]:
    """Return verifiers: judge an episode from its evidence (Hydra group ``verifier``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_agents() -> Iterable[Component[Agent]]:
    """Return software agents that work at a shell in a sandbox (Hydra group ``agent``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_language_models() -> Iterable[Component[LanguageModel]]:
    """Return language models for components that say ``needs=("language",)`` (Hydra group ``language``)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_config_search_path() -> Iterable[str]:
    """Return Hydra search paths with YAML presets of this plugin, such as ``pkg://mine.conf``."""
    raise AssertionError("specification only")
