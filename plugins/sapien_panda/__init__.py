"""A Panda arm at a table in SAPIEN: contact physics on the CPU, four RGB-D cameras by ray casting."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.backend import RobotBackend


@dataclass
class SapienPandaConfig(ComponentConfig):
    """Options of ``sapien_panda``; metres, radians, seconds, newtons.

    ``cameras`` are names out of front, left_shoulder, right_shoulder and wrist; ``image_size`` is their side in
    pixels, ``video_size`` and ``video_fps`` those of the pictures taken while the arm moves (from the first
    camera). ``physics_rate`` is in steps a second. The arm's joints are position drives with feed-forward
    velocity: ``arm_stiffness`` Nm/rad, ``arm_damping`` Nms/rad, ``arm_force`` Nm. ``grip_force`` is the
    most that one finger presses with, ``grip_speed`` how fast one finger moves. ``attach`` ties what both fingers
    touch to the hand until they open, instead of holding it by friction alone.
    """

    image_size: int = 256
    cameras: list[str] = field(default_factory=lambda: ["front", "left_shoulder", "right_shoulder", "wrist"])
    video_size: int = 320
    video_fps: float = 5.0
    physics_rate: int = 240
    arm_stiffness: float = 4000.0
    arm_damping: float = 400.0
    arm_force: float = 100.0
    grip_force: float = 40.0
    grip_speed: float = 0.05
    finger_friction: float = 2.0
    table_friction: float = 0.8
    attach: bool = False


def _build(config: SapienPandaConfig) -> RobotBackend:
    """A simulated Panda at a table: contact grasps on CPU physics, RGB-D by ray casting."""
    from gvla2_plugins.sapien_panda.backend import SapienPanda

    return SapienPanda(config)


@hookimpl
def gvla2_robots() -> list[Component[RobotBackend]]:
    """The simulated Panda."""
    return [Component("sapien_panda", SapienPandaConfig, _build)]
