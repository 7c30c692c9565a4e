"""Small real inputs for checks: an arm that is a gantry, a table with boxes on it, seen by ray casting, and objects
derived from it.

Arrays are read-only: a component that writes into its input fails at once. Metres, world frame, z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import trimesh

from gvla2.episode.evidence import RobotEvidence
from gvla2.geometry.camera import Camera
from gvla2.geometry.exchange import read_only
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import (
    FloatArray,
    box_corners,
    invert_rigid,
    look_along,
    rigid,
    transform_points,
)
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.arm import Attachment, Clearance, Hand, IKSolution
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint, grasp_rotation
from gvla2.robot.report import ExecutionReport, WaypointReport

DOWN = np.array([0.0, 0.0, -1.0])
TILT = 0.05
"""Maximum deviation of a reachable pose from straight down, as 1 - cos."""

SPARE_TRAVEL = 0.1
"""Metres that the axes go beyond the workspace, so that its border is not a joint limit."""


class Gantry:
    """Joints (x, y, z, yaw) in metres and radians: the hand always points down.

    ``workspace`` bounds the tool centre point. The hand is a box about the fingers; clearance is exact for
    points against oriented boxes, taken over the corners and edges of the hand.
    """

    def __init__(self, workspace: Box, hand: Hand | None = None) -> None:
        self.workspace = workspace
        self.hand = hand or Hand(
            max_width=0.08,
            finger_length=0.05,
            finger_thickness=0.015,
            finger_breadth=0.02,
            tip_beyond_tcp=0.01,
            palm_breadth=0.2,
            palm_depth=0.06,
        )
        centre = 0.5 * (workspace.low + workspace.high)
        self.home: FloatArray = np.array([centre[0], centre[1], workspace.high[2] - 0.1, 0.0])

    def forward(self, joints: FloatArray) -> FloatArray:
        """world_from_tcp (4, 4) at joints (4,)."""
        x, y, z, yaw = (float(v) for v in joints)
        closing = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        return rigid(grasp_rotation(DOWN, closing), (x, y, z))

    def inverse(self, world_from_tcp: FloatArray, near: FloatArray | None = None) -> IKSolution | None:
        """Joints for a pose that points down inside the workspace, else None."""
        approach, closing, position = world_from_tcp[:3, 2], world_from_tcp[:3, 1], world_from_tcp[:3, 3]
        if 1.0 - approach @ DOWN > TILT or not self.workspace.contains(position):
            return None
        turn = float(np.arctan2(-closing[0], closing[1]))
        if near is not None:  # the hand is symmetric: take the nearer half turn
            turn += np.pi * round((float(near[3]) - turn) / np.pi)
        joints = np.array([*position, turn])
        inside = min((position - self.workspace.low).min(), (self.workspace.high - position).min())
        return IKSolution(joints, float(inside) + SPARE_TRAVEL, 1.0)

    def clearance(
        self,
        joints: FloatArray,
        gripper: float,
        scene: Scene,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> Clearance:
        """Smallest distance of the hand (and of what it holds) to the scene's boxes and the table."""
        tcp = self.forward(joints)
        points = transform_points(tcp, self._hand_points(gripper))
        carried = attached.object.id if attached else ""
        if attached is not None:
            corners = box_corners(attached.object.extents)
            points = np.vstack([points, transform_points(tcp @ attached.tcp_from_object, corners)])
        found = [Clearance(float("inf"))]
        for obj in scene.obstacles(allowed_contacts | {carried}):
            found.append(Clearance(_distance(points, obj), "hand", obj.id))
        if "table" not in allowed_contacts:
            found.append(Clearance(float(points[:, 2].min() - scene.table_height), "hand", "table"))
        return min(found, key=lambda c: c.distance)

    def line(
        self, start: FloatArray, world_from_tcp: FloatArray, step: float = 0.01
    ) -> Sequence[FloatArray] | None:
        """Joints (4,) along a straight line; a gantry's joints move straight as well."""
        end = self.inverse(world_from_tcp, start)
        if end is None:
            return None
        count = max(2, int(np.ceil(np.linalg.norm(end.joints[:3] - start[:3]) / step)) + 1)
        return list(np.linspace(start, end.joints, count))

    def _hand_points(self, gripper: float) -> FloatArray:
        """(N, 3) points on both fingers and the palm, tool frame."""
        hand = self.hand
        inner, top = 0.5 * hand.max_width * gripper, hand.tip_beyond_tcp - hand.finger_length
        breadth, across = 0.5 * hand.finger_breadth, (inner, inner + hand.finger_thickness)
        heights = np.linspace(top, hand.tip_beyond_tcp, 4)
        fingers = product((-breadth, breadth), (*across, *(-y for y in across)), heights)
        palm = product((-0.5 * hand.palm_depth, 0.5 * hand.palm_depth), (-0.5, 0.5), (top,))
        return np.array([*fingers, *((x, y * hand.palm_breadth, z) for x, y, z in palm)])


def _distance(points: FloatArray, obj: SceneObject) -> float:
    """Signed distance from points (N, 3) to the object's oriented box, the smallest of all, metres."""
    local = np.abs(transform_points(invert_rigid(obj.world_from_object), points)) - 0.5 * obj.extents
    outside = np.linalg.norm(np.maximum(local, 0.0), axis=1)
    return float((outside + np.minimum(local.max(axis=1), 0.0)).min())


TABLE = 0.62
WORKSPACE = Box(np.array([-0.1, -0.45, TABLE]), np.array([0.7, 0.45, TABLE + 0.8]))
INSTRUCTION = "lift the red cube"


@dataclass(frozen=True)
class Block:
    """A box on the table: ``side`` lengths, ``centre`` (x, y) and its turn about z."""

    label: str
    colour: str
    rgb: tuple[float, float, float]
    side: float
    centre: tuple[float, float]
    yaw: float

    @property
    def world_from_block(self) -> FloatArray:
        """(4, 4), standing on the table."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return rigid([[c, -s, 0], [s, c, 0], [0, 0, 1]], (*self.centre, TABLE + 0.5 * self.side))

    def surface(self, index: int) -> Surface:
        """Its triangles in the world frame."""
        cube = trimesh.creation.box((self.side,) * 3)
        return Surface(
            transform_points(self.world_from_block, cube.vertices), cube.faces, np.array(self.rgb), index
        )


RED = Block("red cube", "red", (0.85, 0.10, 0.10), 0.052, (0.30, -0.08), 0.4)
BLUE = Block("blue cube", "blue", (0.10, 0.20, 0.85), 0.047, (0.34, 0.12), -0.2)


def cameras(size: int = 96) -> list[Camera]:
    """Three square cameras around the table that look at the blocks."""
    target = np.array([0.32, 0.02, TABLE + 0.02])
    places = ([0.95, 0.05, TABLE + 0.65], [0.05, 0.55, TABLE + 0.7], [0.05, -0.5, TABLE + 0.7])
    return [
        Camera.from_fov(0.7, look_along(p, target - np.array(p)), size, size, f"camera_{i}")
        for i, p in enumerate(places)
    ]


def views(size: int = 96, masked: Block | None = None) -> Views:
    """RGB-D views of the table and both blocks; with ``masked`` each has that block's silhouette."""
    plane = Surface(
        np.array([[-2.0, -2, TABLE], [2, -2, TABLE], [2, 2, TABLE], [-2, 2, TABLE]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.array([0.62, 0.55, 0.45]),
        0,
    )
    caster = RayCaster([plane, RED.surface(1), BLUE.surface(2)])
    wanted = {None: -1, RED: 1, BLUE: 2}[masked]
    made = []
    for camera, seen in zip(cameras(size), caster.cast(cameras(size), {}), strict=True):
        mask = (seen.ids == wanted).astype(np.float32) if masked else None
        made.append(View(camera, seen.image, seen.depth, mask, np.zeros((size, size), dtype=np.bool_)))
    return read_only(Views(tuple(made)))


def gantry() -> Gantry:
    """An arm over the table."""
    return Gantry(WORKSPACE)


def observation(size: int = 96) -> Observation:
    """The views, and the gantry's hand at home, open."""
    arm = gantry()
    seen = Observation(views(size), arm.forward(arm.home), arm.home, 1.0, arm.hand.max_width)
    return read_only(seen)


def scene(*blocks: Block) -> Scene:
    """A perfect perceiver's scene of the blocks; both of them by default."""
    rng = np.random.default_rng(7)
    objects = []
    for block in blocks or (RED, BLUE):
        points = rng.uniform(-0.5, 0.5, (300, 3))
        axis = rng.integers(0, 3, 300)
        points[np.arange(300), axis] = np.sign(points[np.arange(300), axis]) * 0.5
        seen = transform_points(block.world_from_block, points * block.side)
        objects.append(
            SceneObject(
                id=block.label.replace(" ", "_"),
                label=block.label,
                shape="box",
                colour=block.colour,
                world_from_object=block.world_from_block,
                extents=np.full(3, block.side),
                points=seen,
                rgb=np.array(block.rgb),
            )
        )
    return read_only(Scene(tuple(objects), TABLE, WORKSPACE, perceiver="testing"))


def plan_request(instruction: str = INSTRUCTION) -> PlanRequest:
    """Everything a planner gets, for the two blocks and the gantry."""
    arm, seen = gantry(), observation(48)
    return PlanRequest(instruction, scene(), arm, seen.world_from_tcp, seen.joints, seen)


def evidence(lifted: bool = True) -> RobotEvidence:
    """Evidence of one lift: the red block ends in the hand 20 cm up, or at its old place with the hand empty."""
    before = scene()
    cube = before["red_cube"]
    up = cube.centre + np.array([0.0, 0.0, 0.2])
    points = [cube.centre + np.array([0.0, 0.0, 0.1]), cube.centre, up]
    waypoints = tuple(
        Waypoint((float(p[0]), float(p[1]), float(p[2])), g, stage)
        for p, g, stage in zip(points, (1.0, 0.0, 0.0), ("approach", "grasp", "lift"), strict=True)
    )
    reports = tuple(
        WaypointReport(i, w.stage, w.xyz, w.xyz, 0.001, RED.side if lifted else 0.0, lifted and i > 0)
        for i, w in enumerate(waypoints)
    )
    pose = cube.world_from_object.copy()
    pose[:3, 3] = up
    risen = replace(cube, world_from_object=pose, points=cube.points + np.array([0.0, 0.0, 0.2]))
    return RobotEvidence(
        instruction=INSTRUCTION,
        transcript="approach, grasp, lift: carried out",
        before=before,
        after=before.with_object(read_only(risen)) if lifted else before,
        plan=Plan(Trajectory(waypoints), "pick", {"theme": cube.id}, {"lift_height": 0.2}),
        checks=CheckReport(),
        report=ExecutionReport(reports, 3.0),
        gripper_width=RED.side if lifted else 0.0,
    )


def ball(
    count: int = 400, radius: float = 0.05, rgb: tuple[float, float, float] = (0.9, 0.2, 0.1)
) -> Gaussians:
    """Opaque round Gaussians that fill a ball about the origin."""
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centres = directions * radius * rng.uniform(0, 1, (count, 1)) ** (1 / 3)
    return Gaussians(
        centres=centres.astype(np.float32),
        log_scales=np.full((count, 3), np.log(0.2 * radius), dtype=np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (count, 1)),
        opacity_logits=np.full(count, 4.0, dtype=np.float32),
        sh_dc=np.tile(((np.array(rgb) - 0.5) / SH_C0).astype(np.float32), (count, 1)),
    )
