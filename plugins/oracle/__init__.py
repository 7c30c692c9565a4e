"""The oracle perceiver: the simulator's own truth in place of perception, to find out whose fault a failure is."""

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
    """Tells the true scene of a simulator, unseen things too; for debugging, and every result says so."""
    from gvla2_plugins.oracle.perceiver import OraclePerceiver

    return OraclePerceiver(robot)


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceiver ``oracle``."""
    return [Component("oracle", OracleConfig, _build, needs=("robot",))]
