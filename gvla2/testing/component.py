"""Conformance of the component itself: name, options, laziness, and on request its build."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from gvla2.component import Component
from gvla2.plugins.kinds import KINDS, Kind, kind_of
from gvla2.plugins.registry import load_plugins
from gvla2.plugins.validation import fault_of_item, structured
from gvla2.testing.agent import check_agent
from gvla2.testing.camera import check_camera
from gvla2.testing.conformance import allowed, require, require_members, require_type
from gvla2.testing.inducer import check_inducer
from gvla2.testing.judge import check_judge
from gvla2.testing.language_model import check_language
from gvla2.testing.memory import check_embedder, check_memory, check_retriever, check_verifier
from gvla2.testing.planning import check_perceiver, check_planner
from gvla2.testing.reconstruction import (
    check_axis,
    check_fusion,
    check_prior,
    check_reconstructor,
    check_renderer,
)
from gvla2.testing.robot import check_robot, check_task
from gvla2.testing.tracker import check_tracker, check_viewer

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
    "verifier": check_verifier,
    "agent": check_agent,
    "tracker": check_tracker,
    "view": check_viewer,
    "language": check_language,
}
"""The check of each kind, called with its defaults."""


def check_component(component: Component[Any], kind: str | Kind = "", **needs: object) -> None:
    """Whether gvla2 would accept the component, and whether its options survive YAML and worker processes.

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
