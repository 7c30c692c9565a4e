"""An arm from its URDF at a table: kinematics, hand, home, working area, cameras."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import FloatArray, invert_rigid, look_along, rigid
from gvla2.planning.arm import Hand
from gvla2.planning.scene import Box, Scene
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.collision import CollisionModel
from gvla2.robot.grippers import (
    CUP_LENGTH,
    SUCTION_HAND,
    SUNK,
    TIP_BEYOND_TCP,
    Gripper,
    known,
    measured,
    mount,
    own_gripper,
)
from gvla2.robot.kinematics import Kinematics, library
from gvla2.robot.looks import link_surfaces
from gvla2.robot.options import WorkcellConfig
from gvla2.robot.task import Body, Primitive
from gvla2.robot.urdf import find_file, freeze, read_urdf, without_looks

CAMERAS = {
    "front": (1.1, 0.0, 0.828, -0.906, 0.0, -0.423),
    "left_shoulder": (-0.425, 0.2, 1.228, 0.416, -0.073, -0.906),
    "right_shoulder": (-0.425, -0.2, 1.228, 0.416, 0.073, -0.906),
}
"""Position, from the site's centre on the table's top, and viewing direction; metres."""

TCP_FROM_WRIST = look_along((-0.07, 0.0, -0.085), (0.12, 0.0, 1.0), up=(-1.0, 0.0, 0.0))
"""The wrist's camera is on the far side of the hand, looking past the fingers."""

NEAREST, FARTHEST, STEP, LOW, HIGH = 0.15, 1.4, 0.05, 0.04, 0.20
"""Where pointing down is tested: range before the base, step, heights over the table; metres."""

SEEN = (0.65, 0.91)
"""Size of the table, metres, about the cameras' field of view: an automatic site is never larger."""

HOME_HEIGHTS = (0.55, 0.45, 0.35, 0.25)
"""Heights over the middle of the working area, in shares of the arm's reach: home is at the first reachable one."""


_WRIST = "wrist"
_FOV, _WRIST_FOV = np.deg2rad(40.0), np.deg2rad(60.0)


@dataclass(frozen=True)
class Mounts:
    """Where a cell's cameras are.

    ``fixed``: position and viewing direction in the world, metres, by name. ``tcp_from_wrist`` (4, 4) is the
    camera ``wrist`` on the hand.
    """

    fixed: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]]
    tcp_from_wrist: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """All cameras there are."""
        return (*self.fixed, _WRIST)

    def check(self, names: Sequence[str]) -> None:
        """Raises :class:`ConfigurationError` for an unknown camera, one named twice, or none at all."""
        unknown = [name for name in names if name not in self.names]
        if unknown or not names or len(set(names)) != len(names):
            raise ConfigurationError(
                f"robot.cameras={list(names)} must be one or more different names out of {', '.join(self.names)}."
            )

    def camera(self, name: str, size: int, world_from_tcp: FloatArray) -> Camera:
        """The camera of that name with square images of ``size`` pixels; the wrist's moves with the tool."""
        if name == _WRIST:
            return Camera.from_fov(float(_WRIST_FOV), world_from_tcp @ self.tcp_from_wrist, size, size, name)
        position, forward = self.fixed[name]
        return Camera.from_fov(float(_FOV), look_along(position, forward), size, size, name)


TABLE_RGB = (0.76, 0.61, 0.43)
"""Wood; apart from all twenty colour words."""

TABLE_THICKNESS = 0.05


@dataclass(frozen=True)
class Workcell:
    """Everything specific to one simulated arm; metres, world frame.

    ``urdf`` is a text without visuals and materials, its meshes by absolute path. ``looks`` are the links' surfaces in
    their own frames, by name. ``hand_from_tcp`` (4, 4) is the tool centre point in the frame of the gripper's palm;
    closed fingers are ``gap`` apart. ``base_links`` don't move. Tasks are laid out in the rectangle ``site_size``
    (x, y) about ``site_centre``, on ``table``. ``either_way``: a place is in reach when the hand gets there with its
    fingers either way round, for a wrist that turns less than once, and with a manipulability of ``ease`` at least (a
    share of the arm's best). Pointing down it gets no farther than ``reach`` from the base's axis.
    """

    robot: str
    arm: ArmModel
    urdf: str
    looks: Mapping[str, Surface]
    world_from_base: FloatArray
    base_links: frozenset[str]
    gripper: Gripper
    hand_from_tcp: FloatArray
    gap: float
    table: Body
    site_centre: tuple[float, float]
    site_size: tuple[float, float]
    mounts: Mounts
    either_way: bool
    ease: float
    reach: float

    @property
    def table_height(self) -> float:
        """Of the table's top."""
        return float(self.table.world_from_body[2, 3]) + 0.5 * self.table.solids[0].size[2]


def table_of(size: tuple[float, float], centre: tuple[float, float], height: float) -> Body:
    """A wooden table top: sides ``size`` (x, y), its upper side at ``height``."""
    top = Primitive("box", (*size, TABLE_THICKNESS), TABLE_RGB)
    return Body("table", (top,), rigid(translation=(*centre, height - 0.5 * TABLE_THICKNESS)), fixed=True)


def make_cell(config: WorkcellConfig) -> Workcell:
    """The simulation of the arm that the options describe; raises :class:`RobotError` on what is wrong."""
    _whole(config)
    file = find_file(config.urdf, "robot.urdf")
    robot = read_urdf(file)
    links = [link.get("name", "") for link in robot.iterfind("link")]
    known("robot.tool_link", config.tool_link, links)
    gripper = own_gripper(robot, config) if config.gripper_joints else mount(robot, config)
    freeze(robot, (config.tool_link, gripper.palm), [finger.joint for finger in gripper.fingers])
    base = rigid(Rotation.from_euler("z", config.base_yaw).as_matrix(), np.array(config.base_position))
    urdf = without_looks(robot)
    with tempfile.TemporaryDirectory(prefix="gvla2-arm-") as folder:
        path = Path(folder) / file.name
        path.write_text(urdf)
        kinematics, gripper, hand = _tool(path, robot, config, gripper, base)
        srdf = find_file(config.srdf, "robot.srdf") if config.srdf else None
        collisions = CollisionModel(kinematics, path, (), hand_links=gripper.links, srdf=srdf)
    frames = {
        str(f.name): f for f in kinematics.model.frames if f.type == library("pinocchio").FrameType.BODY
    }
    palm = frames[gripper.palm]
    if palm.parentJoint != kinematics.tcp_joint:
        raise RobotError(
            f"robot.tool_link={config.tool_link} and the gripper's {gripper.palm} are not one rigid part: a joint of "
            "the arm moves between them. Name a link behind the arm's last joint."
        )
    arm = _at_home(config, kinematics, collisions, hand)
    centre, size, reach = _site(config, arm)
    height = config.table_height
    fixed = config.camera_poses or {
        name: [p[0] + centre[0], p[1] + centre[1], p[2] + height, *p[3:]] for name, p in CAMERAS.items()
    }
    ranges = sum(abs(f.opened - f.closed) for f in gripper.fingers)
    return Workcell(
        robot=config.name,
        arm=arm,
        urdf=urdf,
        looks=link_surfaces(robot),
        world_from_base=base,
        base_links=frozenset(n for n in links if n in frames and frames[n].parentJoint == 0),
        gripper=gripper,
        hand_from_tcp=invert_rigid(palm.placement.homogeneous) @ kinematics.joint_from_tcp,
        gap=max(0.0, hand.max_width - ranges),
        table=table_of(_pair(config.table_size), _pair(config.table_centre or centre), height),
        site_centre=centre,
        site_size=size,
        mounts=Mounts(
            {n: ((p[0], p[1], p[2]), (p[3], p[4], p[5])) for n, p in fixed.items()}, TCP_FROM_WRIST
        ),
        either_way=config.either_way,
        ease=config.ease,
        reach=reach,
    )


def _whole(config: WorkcellConfig) -> None:
    """Raises :class:`ConfigurationError` for options that are missing or of the wrong length."""
    missing = [f"robot.{name}=..." for name in config.required if not getattr(config, name)]
    if missing:
        raise ConfigurationError(
            f"robot={config.name} simulates any arm and needs {' and '.join(missing)}: its URDF, and the link that "
            "carries the tool (docs/your_arm.md)."
        )
    lengths = {"base_position": 3, "tool_rpy": 3, "tool_offset": 3, "table_size": 2, "table_centre": 2}
    lengths |= {"site_centre": 2, "site_size": 2, "workspace_low": 3, "workspace_high": 3}
    bad = {
        n: v
        for n, k in lengths.items()
        if len(v := getattr(config, n)) not in ((k, 0) if n in OPEN else (k,))
    }
    bad |= {f"camera_poses.{n}": p for n, p in config.camera_poses.items() if len(p) != 6}
    if config.gripper_joints and config.gripper != WorkcellConfig.gripper:
        raise ConfigurationError(
            f"robot.gripper={config.gripper} is mounted on an arm without fingers of its own, and this one has "
            f"{list(config.gripper_joints)}: add robot.gripper_joints=[]."
        )
    if bad:
        listing = ", ".join(f"robot.{n}={list(v)} ({lengths.get(n, 6)} numbers)" for n, v in bad.items())
        raise ConfigurationError(f"Options of the wrong length: {listing}.")


OPEN = ("tool_offset", "table_centre", "site_centre", "site_size", "workspace_low", "workspace_high")
"""Options that are determined automatically if empty."""


def _tool(
    urdf: Path, robot: ET.Element, config: WorkcellConfig, gripper: Gripper, base: FloatArray
) -> tuple[Kinematics, Gripper, Hand]:
    """The arm's kinematics to its tool centre point, and the hand's geometry, measured if not given."""

    def kinematics(tool_from_tcp: FloatArray) -> Kinematics:
        return Kinematics(
            urdf,
            world_from_base=base,
            tcp_frame=config.tool_link,
            frame_from_tcp=rigid(Rotation.from_euler("xyz", config.tool_rpy).as_matrix()) @ tool_from_tcp,
            fingers=gripper.fingers,
            limit_margin=config.limit_margin,
        )

    if not gripper.fingers:
        at = config.tool_offset or (0.0, 0.0, CUP_LENGTH + SUNK)
        return kinematics(rigid(translation=at)), gripper, SUCTION_HAND
    shapes = link_surfaces(robot, drawn=False)
    bare = [link for link in gripper.links if link not in shapes]
    if bare:
        raise RobotError(
            f"The gripper's links {bare} have no shape; give them a <collision>, or name other joints."
        )
    vertices = {link: np.asarray(shapes[link].vertices) for link in gripper.links}
    gripper, tool_from_tips, sizes = measured(kinematics(np.eye(4)), gripper, vertices)
    tcp = tool_from_tips @ rigid(translation=(0.0, 0.0, -TIP_BEYOND_TCP))
    if config.tool_offset:
        tcp[:3, 3] = config.tool_offset
    sizes["tip_beyond_tcp"] = float(tool_from_tips[2, 3] - tcp[2, 3])
    unknown = sorted(config.hand.keys() - sizes.keys())
    if unknown:
        raise ConfigurationError(
            f"robot.hand has no {', '.join(unknown)}; it has {', '.join(sorted(sizes))}."
        )
    return kinematics(tcp), gripper, Hand(**{**sizes, **config.hand})


def _at_home(
    config: WorkcellConfig, kinematics: Kinematics, collisions: CollisionModel, hand: Hand
) -> ArmModel:
    """The arm with its home, given or found, clear of itself and of the table."""
    x, y, _ = config.base_position
    far = FARTHEST + 0.1
    low = np.array(config.workspace_low or (x - far, y - far, config.table_height))
    high = np.array(config.workspace_high or (x + far, y + far, config.table_height + 1.0))

    def at(home: FloatArray) -> ArmModel:
        return ArmModel(kinematics, collisions, hand=hand, home=home, workspace=Box(low, high))

    names, rest = kinematics.joint_names, np.array(config.home, dtype=np.float64)
    if not len(rest):
        return at(_find_home(config, at(0.5 * (kinematics.low + kinematics.high))))
    if len(rest) != len(names) or kinematics.limit_distance(rest) < 0:
        limits = zip(names, kinematics.low, kinematics.high, strict=True)
        listing = ", ".join(f"{n} {a:.2f}…{b:.2f}" for n, a, b in limits)
        raise RobotError(
            f"robot.home={list(config.home)} must be {len(names)} angles (radians) within the limits: {listing}. "
            "If empty, a home is searched."
        )
    arm = at(rest)
    clear = arm.clearance(rest, 1.0, Scene((), config.table_height, arm.workspace))
    if clear.distance < 0:
        raise RobotError(
            f"At robot.home={list(config.home)} {clear.robot_part} is {-1e3 * clear.distance:.0f} mm in {clear.other}. "
            "Give another, or leave it empty to search one. If the two may touch, name the pair in robot.srdf."
        )
    return arm


def _find_home(config: WorkcellConfig, arm: ArmModel) -> FloatArray:
    """Joints with the hand over the middle of the working area, pointing down, clear of everything.

    The best are those from which the arm reaches, clear of the table and itself, most places of the site: planning
    takes the joints nearest to home, so a home with its elbow down would keep it down.
    """
    scene = Scene((), config.table_height, arm.workspace)
    run = _pointing_down(config, arm)
    middle, places = (
        0.5 * (run[0] + run[-1]),
        [(run[i], y) for i in (0, len(run) // 2, -1) for y in (-0.2, 0.0, 0.2)],
    )
    best, worth = None, -np.inf
    for height in (share * run[-1] for share in HOME_HEIGHTS):
        solutions = [s for sign in (1.0, -1.0) for s in arm.ik.solutions(_down(config, middle, height, sign))]
        for solution in (s for s in solutions if arm.clearance(s.joints, 1.0, scene).distance > 0.01):
            home = _unwound(solution.joints, arm)
            value = (
                min(solution.limit_margin, 0.5) + solution.manipulability - 0.1 * float(np.abs(home).max())
            )
            for before, beside in places:
                found = arm.inverse(_down(config, before, LOW, 1.0, beside), home)
                value += found is not None and arm.clearance(found.joints, 1.0, scene).distance > 0.0
            if value > worth:
                best, worth = home, value
        if best is not None:
            return np.asarray(best)
    raise RobotError(
        f"No home is free of collisions {middle:.2f} m before the base, over the table, with the hand pointing down. "
        "Give robot.home=[...] (radians), or robot.srdf with the pairs of links that may touch."
    )


def _unwound(joints: FloatArray, arm: ArmModel) -> FloatArray:
    """The same posture with each joint less than half a turn from zero, if its limits allow it."""
    turned = joints - 2 * np.pi * np.round(joints / (2 * np.pi))
    low, high = arm.limits
    return np.where((turned > low) & (turned < high), turned, joints)


def _pointing_down(config: WorkcellConfig, arm: ArmModel) -> list[float]:
    """Distances before the base, metres, at which the hand points down near the table and above it: the longest run."""
    runs: list[list[float]] = [[]]
    for before in np.arange(NEAREST, FARTHEST, STEP).tolist():
        if all(_gets_to(arm, config, before, height) for height in (LOW, HIGH)):
            runs[-1].append(before)
        elif runs[-1]:
            runs.append([])
    longest = max(runs, key=len)
    if len(longest) < 2:
        raise RobotError(
            f"The hand of robot={config.name} points down at the table nowhere before its base: z of "
            f"robot.tool_link={config.tool_link}, turned by robot.tool_rpy, must point out of the hand; else the table "
            f"(robot.table_height={config.table_height}) is too low or too high for the base ({config.base_position})."
        )
    return longest


def _gets_to(arm: ArmModel, config: WorkcellConfig, before: float, height: float) -> bool:
    found = (arm.inverse(_down(config, before, height, sign)) for sign in (1.0, -1.0))
    return any(s is not None and s.manipulability >= config.ease for s in found)


def _down(
    config: WorkcellConfig, before: float, height: float, closing: float, beside: float = 0.0
) -> FloatArray:
    """world_from_tcp (4, 4), pointing down ``before`` and ``beside`` the base, ``height`` over the table."""
    x, y, _ = config.base_position
    turn = grasp_rotation(np.array([0.0, 0.0, -1.0]), np.array([0.0, closing, 0.0]))
    return rigid(turn, (x + before, y + beside, config.table_height + height))


def _pair(sides: Sequence[float]) -> tuple[float, float]:
    return sides[0], sides[1]


def _site(config: WorkcellConfig, arm: ArmModel) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Where tasks are laid out: centre, sides; and how far from the base's axis the hand points down; metres."""
    x, y, _ = config.base_position
    reach = config.reach or np.inf
    if config.site_centre and config.site_size:
        return _pair(config.site_centre), _pair(config.site_size), reach
    run = _pointing_down(config, arm)
    centre = config.site_centre or (x + 0.5 * (run[0] + run[-1]), y)
    size = config.site_size or (min(run[-1] - run[0], SEEN[0]), min(1.1 * run[-1], SEEN[1]))
    return _pair(centre), _pair(size), min(reach, run[-1] + STEP)
