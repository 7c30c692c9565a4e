"""Options of tasks, cameras and arms that the command line's schema shows: nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from gvla2.component import ComponentConfig, check_ranges
from gvla2.errors import ConfigurationError

KINDS = ("none", "gaussian", "l515", "realistic", "poor", "bad")


@dataclass
class DepthNoise:
    """Errors of a cell's cameras; independent of each other, all off by default.

    Per pixel: the deviation at a depth of d metres is ``sigma_m`` + ``sigma_rel`` * d metres; ``dropout`` is the share
    of pixels in [0, 1] that measure nothing; ``flying`` the share of those at steps in depth that lie between both
    sides; ``grazing`` and ``dark`` the shares lost on surfaces at grazing angles and on dark ones; ``quantum_m`` the
    unit of depth, metres; ``colour`` the deviation of colours, in [0, 1].

    Per camera, constant over an episode: ``bias_rel`` the deviation over cameras of an error in scale of depth,
    ``exposure`` that of their gain, and the error of their believed pose, ``offset_m`` metres and ``turn_deg`` degrees.
    ``kind`` names this noise in reports. :mod:`gvla2.robot.depth_noise` has the sources. Raises
    :class:`ConfigurationError` for values out of range.
    """

    kind: str = "none"
    sigma_m: float = 0.0
    sigma_rel: float = 0.0
    dropout: float = 0.0
    flying: float = 0.0
    grazing: float = 0.0
    dark: float = 0.0
    bias_rel: float = 0.0
    quantum_m: float = 0.0
    colour: float = 0.0
    exposure: float = 0.0
    offset_m: float = 0.0
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigurationError(f"depth_noise.kind is '{self.kind}'; it is one of {', '.join(KINDS)}.")
        shares = dict.fromkeys(("flying", "grazing", "dark"), (0.0, 1.0, "")) | {"dropout": (0.0, 0.999, "")}
        others = dict.fromkeys(vars(self).keys() - {"kind"}, (0.0, 1e3, ""))
        check_ranges(self, "depth_noise", others | shares)


@dataclass
class TaskConfig(ComponentConfig):
    """Base of a task's configuration: a task whose options extend it can be cluttered (:mod:`gvla2.robot.clutter`).

    ``distractors`` simple shapes lie beside what the task needs.
    """

    distractors: int = 0

    @property
    def known_objects(self) -> str:
        """The folder of the meshes that lie there, a gallery for perceivers that are given no other; "" for none."""
        return ""


@dataclass
class ArmConfig(ComponentConfig):
    """Options of an arm from its URDF, over a table; metres, radians.

    ``urdf`` and ``srdf`` are files, by path or as ``package://``; without an SRDF the pairs of links that may touch are
    found by sampling postures. z of ``tool_link``, turned by ``tool_rpy``, points out of the hand. ``gripper_joints``
    are the arm's own two fingers; without any, a parallel gripper is mounted at the tool link.
    ``tool_offset`` is the point between the fingers in the turned tool frame, ``hand`` its size for planners
    (:class:`gvla2.planning.arm.Hand`), ``home`` the resting joints. The base stands at ``base_position``, turned by
    ``base_yaw``. The tool stays between ``workspace_low`` and ``workspace_high``. ``ease`` is the share of the arm's
    best manipulability from which a pose counts as within reach. Empty options are measured or found.
    """

    required: ClassVar[tuple[str, ...]] = ("urdf", "tool_link")

    urdf: str = ""
    srdf: str = ""
    tool_link: str = ""
    tool_rpy: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    tool_offset: list[float] = field(default_factory=list)
    gripper_joints: list[str] = field(default_factory=list)
    hand: dict[str, float] = field(default_factory=dict)
    home: list[float] = field(default_factory=list)
    limit_margin: float = 0.01
    base_position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    base_yaw: float = 0.0
    table_height: float = 0.0
    workspace_low: list[float] = field(default_factory=list)
    workspace_high: list[float] = field(default_factory=list)
    ease: float = 0.06


@dataclass
class PandaArm(ArmConfig):
    """Franka's Panda, whose description comes with gvla2 (Apache-2.0); its world sets base, table and workspace."""

    urdf: str = "package://gvla2/robot/descriptions/panda/panda.urdf"
    srdf: str = "package://gvla2/robot/descriptions/panda/panda.srdf"
    tool_link: str = "panda_hand"
    tool_offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.1034])
    gripper_joints: list[str] = field(default_factory=lambda: ["panda_finger_joint1", "panda_finger_joint2"])
    hand: dict[str, float] = field(
        default_factory=lambda: {
            "max_width": 0.08,
            "finger_length": 0.1129 - 0.066,  # fingertips' end and palm's end from the hand's frame
            "finger_thickness": 0.0152,
            "finger_breadth": 0.022,
            "tip_beyond_tcp": 0.1129 - 0.1034,
            "palm_breadth": 0.204,
            "palm_depth": 0.063,
        }
    )
    home: list[float] = field(default_factory=lambda: [0.0, 0.1745, 0.0, -0.8727, 0.0, 1.2217, 0.7854])
    ease: float = 0.0


@dataclass
class WorkcellConfig(ArmConfig):
    """Options of a simulated arm at a table; metres, radians. Base of a simulated robot's configuration.

    Tasks are laid out before the base, along x, in the rectangle ``site_size`` about ``site_centre``, where the arm
    reaches: ``either_way`` with its fingers one way round, not both; ``reach`` (0: automatic) is the largest distance
    from the base. ``camera_poses`` are position and viewing direction (six numbers) by name. Empty options are found.
    """

    table_size: list[float] = field(default_factory=lambda: [1.5, 1.8])
    table_centre: list[float] = field(default_factory=list)
    site_centre: list[float] = field(default_factory=list)
    site_size: list[float] = field(default_factory=list)
    either_way: bool = True
    reach: float = 0.0
    camera_poses: dict[str, list[float]] = field(default_factory=dict)


@dataclass
class SimulationConfig(ComponentConfig):
    """Options of a simulator that somebody else built (:mod:`gvla2.robot.simulation`).

    The film has ``video_fps`` pictures a second, none at 0. ``acceleration`` bounds the arm's joints (rad/s²),
    ``pace`` multiplies the tool speeds of plans. ``viewpoint`` is from where instructions name sides: "robot", or
    "facing" it, like a camera opposite.
    """

    video_fps: float = 5.0
    acceleration: float = 10.0
    pace: float = 1.6
    viewpoint: str = "robot"

    def __post_init__(self) -> None:
        positive = dict.fromkeys(("acceleration", "pace"), (0.001, 1000000.0, ""))
        check_ranges(self, "robot", positive | {"video_fps": (0.0, 1000.0, "")})
        if self.viewpoint not in ("robot", "facing"):
            raise ConfigurationError(f"robot.viewpoint={self.viewpoint} must be robot or facing.")
