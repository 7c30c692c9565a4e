"""Conformance checks for plugin authors: one per kind.

    def test_my_planner() -> None:
        check_planner(MyPlanner(MyConfig()))

Each raises :class:`ConformanceError` with the broken sentence of the contract. They build small real inputs: two cubes
on a table seen by ray casting, their scene, and a gantry for an arm.
"""

from gvla2.testing.component import CHECKS, check_component, check_tracker, check_viewer
from gvla2.testing.conformance import ConformanceError
from gvla2.testing.language import check_agent, check_language
from gvla2.testing.memory import (
    candidates,
    check_embedder,
    check_inducer,
    check_judge,
    check_memory,
    check_retriever,
    check_verifier,
)
from gvla2.testing.planning import check_perceiver, check_planner, check_skill
from gvla2.testing.reconstruction import (
    check_axis,
    check_fusion,
    check_prior,
    check_reconstructor,
    check_renderer,
)
from gvla2.testing.robot import check_camera, check_robot, check_task

__all__ = [
    "CHECKS",
    "ConformanceError",
    "candidates",
    "check_agent",
    "check_axis",
    "check_camera",
    "check_component",
    "check_embedder",
    "check_fusion",
    "check_inducer",
    "check_judge",
    "check_language",
    "check_memory",
    "check_perceiver",
    "check_planner",
    "check_prior",
    "check_reconstructor",
    "check_renderer",
    "check_retriever",
    "check_robot",
    "check_skill",
    "check_task",
    "check_tracker",
    "check_verifier",
    "check_viewer",
]
