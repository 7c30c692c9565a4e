"""The oracle perceiver: the simulator's ground truth in place of perception, to locate the cause of failures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.planning.contracts import Perceiver
    from gvla2.robot.backend import RobotBackend


@dataclass
class OracleConfig(ComponentConfig):
    """The ``oracle`` perceiver has no options."""


def _build(config: OracleConfig, robot: RobotBackend | None = None) -> Perceiver:
    """Gives the true scene of a simulator, including unseen objects; for debugging, and every result says so."""
    from gvla2_plugins.oracle.perceiver import OraclePerceiver

    return OraclePerceiver(robot)


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceiver ``oracle``."""
    return [Component("oracle", OracleConfig, _build, needs=("robot",))]
