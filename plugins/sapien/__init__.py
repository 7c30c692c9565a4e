"""Arms at a table in SAPIEN, any by its URDF: contact physics on the CPU, RGB-D cameras by ray casting."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.robot.options import PandaArm, WorkcellConfig

if TYPE_CHECKING:
    from gvla2.robot.backend import RobotBackend


@dataclass
class SapienArmConfig(WorkcellConfig):
    """Options of a simulated arm; metres, radians, seconds, newtons.

    ``cameras`` are names out of front, left_shoulder, right_shoulder and wrist, or out of ``camera_poses`` and wrist;
    ``image_size`` is their side in pixels. While the arm moves, ``video_cameras`` (the first camera where none is
    named) take pictures of ``video_size`` pixels, made even, side by side, ``video_fps`` times a second, at 0 never.
    ``physics_rate`` is in steps per second. The arm's joints are position drives with feed-forward velocity:
    ``arm_stiffness`` Nm/rad, ``arm_damping`` Nms/rad, ``arm_force`` Nm. ``grip_force`` is the largest force of one
    finger, ``grip_speed`` a finger's speed.
    """

    name: str = "sapien_arm"
    image_size: int = 256
    cameras: list[str] = field(default_factory=lambda: ["front", "left_shoulder", "right_shoulder", "wrist"])
    video_size: int = 320
    video_cameras: list[str] = field(default_factory=list)
    video_fps: float = 5.0
    physics_rate: int = 240
    arm_stiffness: float = 4000.0
    arm_damping: float = 400.0
    arm_force: float = 100.0
    grip_force: float = 40.0
    grip_speed: float = 0.05
    finger_friction: float = 2.0
    table_friction: float = 0.8


@dataclass
class SapienPandaConfig(PandaArm, SapienArmConfig):
    """``sapien_arm`` set for Franka's Panda, whose description comes with gvla2 (Apache-2.0).

    The home position (0.279, -0.009, 1.472) published with the field's task suite refers to a point 20.9 mm further up
    the hand than the middle of the pads, which is the tool point here: a grasp centred there would touch only the
    fingers' upper ends.
    """

    name: str = "sapien_panda"
    base_position: list[float] = field(default_factory=lambda: [-0.268, -0.006, 0.750])
    table_height: float = 0.752
    table_centre: list[float] = field(default_factory=lambda: [0.30, 0.0])
    site_centre: list[float] = field(default_factory=lambda: [0.25, 0.0])
    site_size: list[float] = field(default_factory=lambda: [0.65, 0.91])
    workspace_low: list[float] = field(default_factory=lambda: [-0.275, -0.655, 0.752])
    workspace_high: list[float] = field(default_factory=lambda: [0.775, 0.655, 1.752])
    either_way: bool = False


@dataclass
class SapienPiperConfig(SapienArmConfig):
    """``sapien_arm`` set for AgileX's Piper, on a block before a table, its fingertips' reach in the picture's middle.

    With its base on the table the wrist's 70 degrees would let the hand point down only up to 0.1 m above it; on the
    block, 0.25 m high, it does so from 0.1 to 0.4 m before the base, and up to 0.3 m high. Tasks are also laid out
    beyond the hand's reach from above, for furniture pulled from its front; the hand cannot point down farther than
    ``reach``. ``ease`` is twice the manipulability at which a plan is refused, to leave some room.
    """

    name: str = "sapien_piper"
    urdf: str = "package://gvla2/robot/descriptions/piper.urdf"
    srdf: str = "package://gvla2/robot/descriptions/piper.srdf"
    tool_link: str = "tcp"
    tool_offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    gripper_joints: list[str] = field(default_factory=lambda: ["finger_left_joint", "finger_right_joint"])
    home: list[float] = field(default_factory=lambda: [0.0, 1.35, -1.0, 0.0, 1.0, 0.0])
    base_position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.25])
    table_size: list[float] = field(default_factory=lambda: [1.5, 1.6])
    table_centre: list[float] = field(default_factory=lambda: [0.45, 0.0])
    site_centre: list[float] = field(default_factory=lambda: [0.57, 0.0])
    site_size: list[float] = field(default_factory=lambda: [0.74, 0.84])
    workspace_low: list[float] = field(default_factory=lambda: [0.05, -0.50, 0.0])
    workspace_high: list[float] = field(default_factory=lambda: [0.95, 0.50, 0.65])
    reach: float = 0.50
    camera_poses: dict[str, list[float]] = field(
        default_factory=lambda: {
            "front": [1.35, 0.0, 0.75, -0.81, 0.0, -0.586],
            "left_shoulder": [-0.05, 0.40, 1.10, 0.344, -0.32, -0.883],
            "right_shoulder": [-0.05, -0.40, 1.10, 0.344, 0.32, -0.883],
        }
    )


def _build(config: SapienArmConfig) -> RobotBackend:
    """A simulated arm from its URDF, with its own fingers or a mounted gripper."""
    from gvla2_plugins.sapien.backend import SapienArm

    return SapienArm(config)


@hookimpl
def gvla2_robots() -> list[Component[RobotBackend]]:
    """The simulated arms: any, and two that are set up."""
    at_a_table = "at a table: contact grasps on CPU physics, RGB-D by ray casting."
    return [
        Component("sapien_panda", SapienPandaConfig, _build, summary=f"A simulated Panda {at_a_table}"),
        Component(
            "sapien_piper", SapienPiperConfig, _build, summary=f"A simulated Piper on a block {at_a_table}"
        ),
        Component("sapien_arm", SapienArmConfig, _build),
    ]
