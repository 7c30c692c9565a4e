"""An arm from its description, such as a URDF: kinematics, hand, home, collision model, and how it looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, RobotError, reading
from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import View
from gvla2.planning.arm import Attachment, Clearance, Hand, IKSolution
from gvla2.planning.scene import Box, Scene
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.collision import CollisionModel
from gvla2.robot.grippers import (
    TIP_BEYOND_TCP,
    Gripper,
    known,
    measured,
    mount,
    own_gripper,
)
from gvla2.robot.ik import InverseKinematics
from gvla2.robot.kinematics import Kinematics, library
from gvla2.robot.looks import OWN_DEPTH, RobotLooks, link_surfaces
from gvla2.robot.options import ArmConfig
from gvla2.robot.urdf import find_file, freeze, read_urdf, without_looks

AHEAD, ABOVE, LOW = 0.45, (0.4, 0.3, 0.2), 0.04
"""Where an unnamed home is: ahead of the base and over the table, in shares of the arm's reach, the first height at
which the hand is clear. From there it must get down to ``LOW`` metres over the table.
"""

FAR = 1.5
"""How far from the base the tool may go by default, metres."""

LENGTHS = {"base_position": 3, "tool_rpy": 3, "table_size": 2}
OPTIONAL = {
    "tool_offset": 3, "workspace_low": 3, "workspace_high": 3, "table_centre": 2, "site_centre": 2, "site_size": 2,
}  # fmt: skip
"""Lengths of list options; the optional ones are determined automatically if empty."""


class ArmModel:
    """Implements :class:`gvla2.planning.arm.Arm`, plus what motion planning needs. Not safe to share between threads.

    ``limits`` are the lower and upper joint limits (dof,), the margin taken off, and
    ``velocity_limits`` the description's joint speeds, rad/s. Raises :class:`RobotError` for a home outside the limits.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        collisions: CollisionModel,
        *,
        hand: Hand,
        home: ArrayLike,
        workspace: Box,
    ) -> None:
        self._home = np.array(home, dtype=np.float64)
        if self._home.shape != (kinematics.dof,) or kinematics.limit_distance(self._home) < 0:
            raise RobotError(
                f"The home {self._home.tolist()} doesn't fit the {kinematics.dof} joints' limits."
            )
        self.kinematics, self.collisions, self.hand, self.workspace = kinematics, collisions, hand, workspace
        self.ik = InverseKinematics(kinematics, self._home)
        self.dof, self.limits = kinematics.dof, (kinematics.low, kinematics.high)
        self.velocity_limits = kinematics.velocity
        self.forward, self.tool_positions = kinematics.forward, kinematics.positions
        self.inverse, self.line = self.ik.solve, self.ik.line
        self.checker = collisions.checker

    @property
    def home(self) -> FloatArray:
        """(dof,) resting joints, radians."""
        return self._home.copy()

    def clearance(
        self,
        joints: FloatArray,
        gripper: float,
        scene: Scene,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> Clearance:
        """Smallest distance of the arm to itself and the scene, metres; links go by their names."""
        return self.checker(scene, gripper, allowed_contacts, attached).clearance(joints)


@dataclass(frozen=True)
class ArmDescription:
    """What an arm is made of, read from what errors call ``source``; metres.

    ``model`` (links are its body frames) and ``solids``, what collides, are pinocchio's. ``surfaces`` are the links'
    looks and ``corners`` (N, 3) of their solids, by name and in their own frames. ``urdf`` is a text without visuals
    and materials, its meshes by absolute path; "" for an arm that has none.
    """

    source: str
    model: Any
    solids: Any
    surfaces: Mapping[str, Surface]
    corners: Mapping[str, FloatArray]
    gripper: Gripper
    urdf: str = ""


@dataclass(frozen=True)
class RobotModel:
    """An arm with its hand, as a description and options make it; metres, world frame.

    ``arm`` plans and checks motions. ``urdf`` and ``surfaces`` are those of the :class:`ArmDescription`; ``base_links``
    don't move. Closed fingers are ``gap`` apart.
    """

    robot: str
    arm: ArmModel
    urdf: str
    surfaces: Mapping[str, Surface]
    world_from_base: FloatArray
    base_links: frozenset[str]
    gripper: Gripper
    gap: float

    @cached_property
    def looks(self) -> RobotLooks:
        """The links for ray casting."""
        return RobotLooks(self.surfaces)

    def mask(
        self, views: Sequence[View], joints: FloatArray, gripper_width: float, tolerance: float = OWN_DEPTH
    ) -> tuple[View, ...]:
        """The views with the robot's own pixels marked, cast from its model at ``joints`` (dof,) radians and fingers
        ``gripper_width`` metres apart: where depth is within ``tolerance`` metres before the model, or behind it.
        """
        poses = self.arm.kinematics.link_poses(joints, gripper_width / self.arm.hand.max_width)
        marked = []
        for view, image in zip(views, self.looks.cast([v.camera for v in views], poses), strict=True):
            own = np.isfinite(image.depth)
            if view.depth is not None:
                with np.errstate(invalid="ignore"):
                    own &= ~(view.depth < image.depth - tolerance)
            marked.append(replace(view, robot_mask=own))
        return tuple(marked)


def arm_from_urdf(config: ArmConfig) -> RobotModel:
    """The arm that the options describe; raises :class:`RobotError` on what is wrong with its URDF.

    Raises :class:`ConfigurationError` for options that are missing or contradict each other.
    """
    _check(config)
    file = find_file(config.urdf, "robot.urdf")
    robot = read_urdf(file)
    links = [link.get("name", "") for link in robot.iterfind("link")]
    known("robot.tool_link", config.tool_link, links)
    gripper = own_gripper(robot, config) if config.gripper_joints else mount(robot, config)
    freeze(robot, (config.tool_link, gripper.palm), [finger.joint for finger in gripper.fingers])
    base = rigid(Rotation.from_euler("z", config.base_yaw).as_matrix(), np.array(config.base_position))
    urdf, pin = without_looks(robot), library("pinocchio")
    with reading("an arm", file, RobotError):  # the libraries' errors name no file
        model = pin.buildModelFromXML(urdf)
        solids = pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION)
    surfaces, shapes = link_surfaces(robot), link_surfaces(robot, drawn=False)
    corners = {link: np.asarray(shape.vertices) for link, shape in shapes.items()}
    description = ArmDescription(file.name, model, solids, surfaces, corners, gripper, urdf)
    return build_arm(description, config, base)


def build_arm(description: ArmDescription, config: ArmConfig, world_from_base: FloatArray) -> RobotModel:
    """The arm of a description, its base at a pose (4, 4); of the options those of its tool, hand, home and workspace
    count. Raises :class:`RobotError` for what does not fit.
    """
    with reading("an arm", description.source, RobotError):
        kinematics, gripper, hand = _tool(description, config, world_from_base)
        srdf = find_file(config.srdf, "robot.srdf") if config.srdf else None
        collisions = CollisionModel(kinematics, description.solids, hand_links=gripper.links, srdf=srdf)
    frames = {
        str(f.name): f for f in kinematics.model.frames if f.type == library("pinocchio").FrameType.BODY
    }
    palm = frames[gripper.palm]
    if palm.parentJoint != kinematics.tcp_joint:
        raise RobotError(
            f"robot.tool_link={config.tool_link} and the gripper's {gripper.palm} are not one rigid part: a joint of "
            "the arm moves between them. Name a link behind the arm's last joint."
        )
    return RobotModel(
        robot=config.name,
        arm=_at_home(config, kinematics, collisions, hand),
        urdf=description.urdf,
        surfaces=description.surfaces,
        world_from_base=world_from_base,
        base_links=frozenset(name for name, frame in frames.items() if frame.parentJoint == 0),
        gripper=gripper,
        gap=max(0.0, hand.max_width - sum(abs(f.opened - f.closed) for f in gripper.fingers)),
    )


def _check(config: ArmConfig) -> None:
    missing = [f"robot.{name}=..." for name in config.required if not getattr(config, name)]
    if missing:
        raise ConfigurationError(
            f"robot={config.name} simulates any arm and needs {' and '.join(missing)}. robot.urdf is its URDF, "
            "robot.tool_link the link that carries the tool (docs/your_arm.md)."
        )
    wrong = [
        f"robot.{name}={list(value)} ({length} numbers)"
        for name, length in {**LENGTHS, **OPTIONAL}.items()
        if len(value := getattr(config, name, ())) != length
        and (value or (name in LENGTHS and hasattr(config, name)))
    ]
    if wrong:
        raise ConfigurationError(f"Options of the wrong length: {', '.join(wrong)}.")


def _tool(
    description: ArmDescription, config: ArmConfig, world_from_base: FloatArray
) -> tuple[Kinematics, Gripper, Hand]:
    """The arm's kinematics to its tool centre point, and the hand's geometry, measured if not given."""
    gripper, corners = description.gripper, description.corners

    def kinematics(tool_from_tcp: FloatArray) -> Kinematics:
        return Kinematics(
            description.model,
            description.source,
            world_from_base=world_from_base,
            tool_link=config.tool_link,
            link_from_tcp=rigid(Rotation.from_euler("xyz", config.tool_rpy).as_matrix()) @ tool_from_tcp,
            fingers=gripper.fingers,
            limit_margin=config.limit_margin,
        )

    bare = [link for link in gripper.links if link not in corners]
    if bare:
        raise RobotError(
            f"The gripper's links {bare} have no shape; give them a <collision>, or name other joints."
        )
    gripper, tool_from_tips, sizes = measured(kinematics(np.eye(4)), gripper, corners)
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


def _at_home(config: ArmConfig, kinematics: Kinematics, collisions: CollisionModel, hand: Hand) -> ArmModel:
    """The arm with its home, given or found, clear of itself and of the table."""
    x, y, _ = config.base_position
    low = np.array(config.workspace_low or (x - FAR, y - FAR, config.table_height))
    high = np.array(config.workspace_high or (x + FAR, y + FAR, config.table_height + 1.0))

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


def _find_home(config: ArmConfig, arm: ArmModel) -> FloatArray:
    """Joints with the hand pointing down over the working area, clear of everything.

    They come from the easiest posture that has the hand near the table, clear of it: planning takes the joints nearest
    to home, so a home with its elbow down would keep it down.
    """
    scene, ahead = Scene((), config.table_height, arm.workspace), AHEAD * arm.ik.reach

    def clear(solution: IKSolution | None) -> bool:
        return solution is not None and arm.clearance(solution.joints, 1.0, scene).distance > 0.01

    def unwound(joints: FloatArray) -> FloatArray:
        """The same posture with each joint less than half a turn from zero, if its limits allow it."""
        turned = joints - 2 * np.pi * np.round(joints / (2 * np.pi))
        return np.where((turned > arm.limits[0]) & (turned < arm.limits[1]), turned, joints)

    def ease(found: tuple[float, IKSolution]) -> float:
        twist = float(np.abs(unwound(found[1].joints)).max())
        return min(found[1].limit_margin, 0.5) + found[1].manipulability - 0.1 * twist

    poses = {sign: _down(config, ahead, LOW, sign) for sign in (1.0, -1.0)}
    lows = [(sign, s) for sign, pose in poses.items() for s in arm.ik.solutions(pose) if clear(s)]
    for sign, low in sorted(lows, key=ease, reverse=True):
        for height in ABOVE:
            found = arm.inverse(_down(config, ahead, height * arm.ik.reach, sign), unwound(low.joints))
            if found is not None and clear(found):
                return unwound(found.joints)
    raise RobotError(
        f"The hand of robot={config.name} cannot point down {ahead:.2f} m before its base, from the table up, clear of "
        "everything: z of robot.tool_link, turned by robot.tool_rpy, must point out of the hand. Give robot.home=[...] "
        "(radians), robot.base_position and table_height, or robot.srdf with the pairs of links that may touch."
    )


def _down(config: ArmConfig, before: float, height: float, closing: float) -> FloatArray:
    """world_from_tcp (4, 4), pointing down ``before`` the base and ``height`` over the table."""
    x, y, _ = config.base_position
    turn = grasp_rotation(np.array([0.0, 0.0, -1.0]), np.array([0.0, closing, 0.0]))
    return rigid(turn, (x + before, y, config.table_height + height))
