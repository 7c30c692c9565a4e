"""Options of robots in MuJoCo worlds, which the command line's schema shows: nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass, field

from gvla2.component import check_ranges
from gvla2.robot.options import SimulationConfig


@dataclass
class MujocoConfig(SimulationConfig):
    """Options that all robots in MuJoCo worlds have, beside those of :class:`SimulationConfig`.

    ``cameras`` are the model's, with square images of ``image_size`` pixels; where ``picture_size`` is larger, their
    colours can also be read with that many, as text on packages is. The film, if one is asked for, is taken by
    ``video_cameras`` (the first of ``cameras`` where none is named), side by side, each with ``video_size`` pixels,
    rounded up to an even number.
    ``joint_speed`` bounds the arm's joints, rad/s. ``stiffness`` is the gain of the joint controller (1/s²).
    """

    cameras: list[str] = field(default_factory=list)
    image_size: int = 256
    picture_size: int = 0
    video_size: int = 256
    video_cameras: list[str] = field(default_factory=list)
    joint_speed: float = 2.2
    stiffness: float = 600.0

    def __post_init__(self) -> None:
        super().__post_init__()
        positive = ("image_size", "video_size", "joint_speed", "stiffness")
        check_ranges(self, "robot", dict.fromkeys(positive, (0.001, 1000000.0, "")))
