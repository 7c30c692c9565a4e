"""Arms at a table in SAPIEN, Panda and Piper: contact physics on the CPU, RGB-D cameras by ray casting."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.backend import RobotBackend


@dataclass
class SapienConfig(ComponentConfig):
    """Options of a simulated arm; metres, radians, seconds, newtons.

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


@dataclass
class SapienPandaConfig(SapienConfig):
    """Options of ``sapien_panda``: those of :class:`SapienConfig`."""


@dataclass
class SapienPiperConfig(SapienConfig):
    """Options of ``sapien_piper``: those of :class:`SapienConfig`."""


def _build_panda(config: SapienPandaConfig) -> RobotBackend:
    """A simulated Panda at a table: contact grasps on CPU physics, RGB-D by ray casting."""
    from gvla2_plugins.sapien.backend import SapienArm
    from gvla2_plugins.sapien.panda import panda_cell

    return SapienArm(config, panda_cell)


def _build_piper(config: SapienPiperConfig) -> RobotBackend:
    """A simulated Piper on a block at a table: contact grasps on CPU physics, RGB-D by ray casting."""
    from gvla2_plugins.sapien.backend import SapienArm
    from gvla2_plugins.sapien.piper import piper_cell

    return SapienArm(config, piper_cell)


@hookimpl
def gvla2_robots() -> list[Component[RobotBackend]]:
    """The simulated arms."""
    return [
        Component("sapien_panda", SapienPandaConfig, _build_panda),
        Component("sapien_piper", SapienPiperConfig, _build_piper),
    ]
