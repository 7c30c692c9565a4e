"""robosuite's own tasks, as a robot: Panda, Sawyer or UR5e at a table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.robot.mujoco.options import MujocoConfig

if TYPE_CHECKING:
    from gvla2.robot.backend import RobotBackend


@dataclass
class RobosuiteConfig(MujocoConfig):
    """Options of ``robosuite``: those of :class:`MujocoConfig`.

    A task is ``robosuite/NAME``; the seed draws its initial state. robosuite has no sentences: the tasks' are ours.
    ``arm`` is one of its robots with one arm, ``gripper`` one of its grippers with two sliding fingers. An episode has
    ``max_steps``, or no end for 0.
    """

    name: str = "robosuite"
    cameras: list[str] = field(
        default_factory=lambda: ["agentview", "frontview", "birdview", "robot0_robotview"]
    )
    image_size: int = 512
    joint_speed: float = 1.0  # its wrists' motors do not overcome the drag of faster ones
    acceleration: float = 4.0
    arm: str = "Panda"
    gripper: str = "PandaGripper"
    settle_steps: int = 10
    max_steps: int = 500


def _build(config: RobosuiteConfig) -> RobotBackend:
    """An arm in robosuite's tasks, judged by their own success checks."""
    from gvla2.robot.mujoco.stepping import import_robosuite
    from gvla2.robot.simulation import SimulatedRobot
    from gvla2_plugins.robosuite.worlds import SENTENCES, RobosuiteWorld

    import_robosuite("robosuite")
    return SimulatedRobot(config, SENTENCES, lambda task: RobosuiteWorld(task, config))


@hookimpl
def gvla2_robots() -> list[Component[RobotBackend]]:
    """The robot ``robosuite``."""
    return [Component("robosuite", RobosuiteConfig, _build)]
