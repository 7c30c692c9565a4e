"""Any MJCF file with an arm of two fingers, as a robot."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.errors import ConfigurationError
from gvla2.robot.mujoco.options import MujocoConfig

if TYPE_CHECKING:
    from gvla2.robot.backend import RobotBackend


@dataclass
class MjcfConfig(MujocoConfig):
    """Options of ``mujoco``: those of :class:`MujocoConfig`.

    ``mjcf`` is the file. The arm is named by its ``base`` and ``tool`` bodies (z of the tool points out of the hand),
    its ``joints`` from the base on, and the two sliding joints of its ``fingers``. Each joint of the arm has a
    position actuator; ``gripper_actuators`` open the fingers towards the end of their control range that is farther
    from zero. ``keyframe`` is the initial state by name, "" for the model's own. The tool stays between
    ``workspace_low`` and ``workspace_high``, over a support at ``table_height``. ``geom_groups`` are the groups that
    cameras see. There is no task but ``none`` and no success check: say what to do by ``instruction=...``.
    """

    required = ("mjcf", "base", "tool", "joints", "fingers", "gripper_actuators", "cameras")

    name: str = "mujoco"
    mjcf: str = ""
    base: str = ""
    tool: str = ""
    joints: list[str] = field(default_factory=list)
    fingers: list[str] = field(default_factory=list)
    gripper_actuators: list[str] = field(default_factory=list)
    keyframe: str = ""
    rate: float = 50.0
    settle_seconds: float = 0.5
    table_height: float = 0.0
    workspace_low: list[float] = field(default_factory=lambda: [-0.8, -0.8, 0.0])
    workspace_high: list[float] = field(default_factory=lambda: [0.8, 0.8, 1.2])
    geom_groups: list[int] = field(default_factory=lambda: [0, 1, 2])


def _build(config: MjcfConfig) -> RobotBackend:
    """An arm in any MJCF file, its cameras and its actuators named by options."""
    from gvla2.robot.simulation import SimulatedRobot
    from gvla2_plugins.mujoco.worlds import MjcfWorld

    missing = [f"robot.{name}=..." for name in config.required if not getattr(config, name)]
    if missing:
        raise ConfigurationError(f"robot=mujoco needs {', '.join(missing)}.")
    if not Path(config.mjcf).expanduser().is_file():
        raise ConfigurationError(f"robot.mjcf={config.mjcf} is no file.")
    return SimulatedRobot(config, {}, lambda task: MjcfWorld(config))


@hookimpl
def gvla2_robots() -> list[Component[RobotBackend]]:
    """The robot ``mujoco``."""
    return [Component("mujoco", MjcfConfig, _build)]
