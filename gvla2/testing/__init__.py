"""Conformance checks for plugin authors: one per kind.

    def test_my_planner() -> None:
        check_planner(MyPlanner(MyConfig()))

Each raises :class:`ConformanceError` that names the broken rule of the contract. They build small real inputs: two
cubes on a table seen by ray casting, their scene, and a gantry for an arm.
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from gvla2.component import Component
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import ConformanceError
from gvla2.geometry.exchange import require, require_type
from gvla2.plugins.kinds import KINDS, Kind, kind_of
from gvla2.plugins.manager import fault_of_item, structured
from gvla2.plugins.registry import load_plugins
from gvla2.record.tracker import TrackedRun, Tracker, Viewer
from gvla2.testing.conformance import allowed, require_members
from gvla2.testing.inputs import INSTRUCTION, observation, scene
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
from gvla2.testing.robot import check_camera, check_policy, check_robot, check_task

__all__ = [
    "CHECKS", "ConformanceError", "candidates", "check_agent", "check_axis", "check_camera", "check_component",
    "check_embedder", "check_fusion", "check_inducer", "check_judge", "check_language", "check_memory",
    "check_perceiver", "check_planner", "check_policy", "check_prior", "check_reconstructor", "check_renderer",
    "check_retriever", "check_robot", "check_skill", "check_task", "check_tracker", "check_verifier", "check_viewer",
]  # fmt: skip


def check_tracker(tracker: Tracker) -> None:
    """Check that the tracker handles a run from begin to end, including one that fails immediately."""
    require_members(tracker, "tracker")
    with tempfile.TemporaryDirectory() as place, allowed("A tracker that gets a run"):
        folder = Path(place)
        (folder / "result.json").write_text("{}")
        config = {"seed": 3, "planner": {"name": "mine", "height": 0.1}, "instruction": None}
        tracker.begin(TrackedRun("a/run", folder, config))
        tracker.episode(0, {"success": 1.0, "seconds/plan": 0.2}, folder)
        tracker.episode(1, {"seconds": 3.0}, folder / "absent")
        tracker.end(well=True)


def check_viewer(viewer: Viewer) -> None:
    """Check that the viewer handles an episode with a scene, and one that ended before; each leaves a file."""
    require_members(viewer, "view")
    blind = EpisodeRecord("run/0", INSTRUCTION, "task", 3, {"robot": "gantry"})
    seen = replace(blind, episode_id="run/1", observation=observation(48), scene=scene())
    for record in (blind, seen):
        with tempfile.TemporaryDirectory() as place, allowed("A viewer that is shown an episode"):
            viewer.show(record, Path(place))
            require(
                any(Path(place).iterdir()),
                "A viewer leaves a file in the episode's folder; this one left none.",
            )


CHECKS: Mapping[str, Callable[[Any], None]] = {
    "robot": check_robot,
    "camera": check_camera,
    "task": check_task,
    "perceiver": check_perceiver,
    "reconstructor": check_reconstructor,
    "prior": check_prior,
    "axis": check_axis,
    "fusion": check_fusion,
    "renderer": check_renderer,
    "memory": check_memory,
    "retriever": check_retriever,
    "embedder": check_embedder,
    "inducer": check_inducer,
    "judge": check_judge,
    "planner": check_planner,
    "policy": check_policy,
    "verifier": check_verifier,
    "agent": check_agent,
    "tracker": check_tracker,
    "view": check_viewer,
    "language": check_language,
}
"""The check of each kind, called with its defaults."""


def check_component(component: Component[Any], kind: str | Kind = "", **needs: object) -> None:
    """Check that gvla2 would accept the component, and that its options survive YAML and worker processes.

    With ``kind`` it is also built with its default options (and ``needs``, by kind) and its kind's check is run. Of
    your own kind, by name where its plugin is found or else as an object, the build must satisfy the protocol.
    """
    require_type(component, Component, "What a hook returns")
    asked = {*component.needs, *([kind] if isinstance(kind, str) and kind else [])}
    known = KINDS if asked <= KINDS.keys() else load_plugins().kinds
    own = kind_of(kind, known) if isinstance(kind, str) and kind else kind
    fault = fault_of_item(component, getattr(own, "hook", ""), known)
    require(not fault, fault)
    require(
        component.summary, f"'{component.name}' has no summary: give its build a docstring, or pass summary=."
    )
    node = structured(component)
    try:
        options = OmegaConf.create(OmegaConf.to_yaml(node))
        OmegaConf.merge(node, options)
    except OmegaConfBaseException as error:
        require(False, f"The options of '{component.name}' do not survive YAML: {error}")
    with allowed(f"Pickling {component.config.__name__}, which sweeps over several processes do,"):
        pickle.loads(pickle.dumps(component.config))
    if not isinstance(own, Kind):
        return
    lacking = set(component.needs) - set(needs)
    require(not lacking, f"'{component.name}' needs {', '.join(sorted(lacking))}: pass them by keyword.")
    with allowed(f"Building '{component.name}' with its default options"):
        made = component.build(OmegaConf.to_object(node), **needs)
    require_members(made, own)
    if own.name in CHECKS:
        CHECKS[own.name](made)
