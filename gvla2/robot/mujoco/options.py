"""Options of robots in MuJoCo worlds, which the command line's schema shows: nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass, field

from gvla2.component import ComponentConfig, check_ranges
from gvla2.errors import ConfigurationError


@dataclass
class MujocoConfig(ComponentConfig):
    """Options that all robots in MuJoCo worlds have; metres, radians, seconds.

    ``cameras`` are the model's, with square images of ``image_size`` pixels; where ``picture_size`` is larger, their
    colours can also be read with that many, as text on packages is. The film, if one is asked for, is taken by
    the first of them with ``video_size`` pixels and ``video_fps`` pictures a second, none at 0. ``joint_speed`` and
    ``acceleration`` bound the arm's joints (rad/s, rad/s²), ``pace`` multiplies the tool speeds of plans. ``stiffness``
    is the gain of the joint controller (1/s²). ``viewpoint`` is from where instructions name sides: "robot", or
    "facing" it, like a camera opposite.
    """

    cameras: list[str] = field(default_factory=list)
    image_size: int = 256
    picture_size: int = 0
    video_size: int = 256
    video_fps: float = 5.0
    joint_speed: float = 2.2
    acceleration: float = 10.0
    pace: float = 1.6
    stiffness: float = 600.0
    viewpoint: str = "robot"

    def __post_init__(self) -> None:
        positive = ("image_size", "video_size", "joint_speed", "acceleration", "pace", "stiffness")
        ranges = dict.fromkeys(positive, (0.001, 1000000.0, "")) | {"video_fps": (0.0, 1000.0, "")}
        check_ranges(self, "robot", ranges)
        if self.viewpoint not in ("robot", "facing"):
            raise ConfigurationError(f"robot.viewpoint={self.viewpoint} must be robot or facing.")
