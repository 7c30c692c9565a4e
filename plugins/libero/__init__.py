"""LIBERO and LIBERO-PRO: their worlds, sentences, initial states and success checks, as a robot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.robot.mujoco.options import MujocoConfig

if TYPE_CHECKING:
    from gvla2.robot.backend import RobotBackend


@dataclass
class LiberoConfig(MujocoConfig):
    """Options of ``libero``: those of :class:`MujocoConfig`; its sentences are those of a viewer who faces the robot.

    A task is ``suite/number``, the seed the number of the benchmark's initial state. The cameras are those of published
    evaluations. After ``settle_steps`` an episode has ``max_steps``; 0 takes the suite's, as in published evaluations
    (spatial 220, object 280, goal 300, Long 520, others 400).
    """

    name: str = "libero"
    cameras: list[str] = field(default_factory=lambda: ["agentview", "robot0_eye_in_hand"])
    viewpoint: str = "facing"
    settle_steps: int = 10
    max_steps: int = 0


def _build(config: LiberoConfig) -> RobotBackend:
    """A Panda in the worlds of LIBERO and LIBERO-PRO, judged by their own success checks."""
    from gvla2_plugins.libero.worlds import LiberoArm

    return LiberoArm(config)


@hookimpl
def gvla2_robots() -> list[Component[RobotBackend]]:
    """The robot ``libero``."""
    return [Component("libero", LiberoConfig, _build)]
