"""Table tops with known objects, ray cast into four cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along, rigid
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.colours import COLOURS
from gvla2.planning.scene import Box

TABLE_TOP = 0.752
TABLE_RGB = (0.62, 0.52, 0.42)
WORKSPACE = Box(np.array([-0.275, -0.655, 0.752]), np.array([0.775, 0.655, 1.752]))
ROBOT_ID = 1000


@dataclass(frozen=True)
class Truth:
    """An object on the table: a box, cylinder or sphere of ``size``, at a pose in the world."""

    kind: str
    size: tuple[float, float, float]
    pose: np.ndarray
    colour: str

    @property
    def centre(self) -> np.ndarray:
        return self.pose[:3, 3]

    def surface(self, number: int) -> Surface:
        if self.kind == "cylinder":
            mesh = trimesh.creation.cylinder(0.5 * self.size[0], self.size[2], sections=48)
        elif self.kind == "sphere":
            mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.5 * self.size[0])
        else:
            mesh = trimesh.creation.box(self.size)
        return Surface(mesh.vertices, mesh.faces, np.array(COLOURS[self.colour]), number)


def put(kind, size, xy, yaw=0.0, colour="red", *, bottom=0.0) -> Truth:
    """An object on the table, or ``bottom`` metres above it."""
    c, s = np.cos(yaw), np.sin(yaw)
    pose = rigid([[c, -s, 0], [s, c, 0], [0, 0, 1]], (*xy, TABLE_TOP + bottom + 0.5 * size[2]))
    return Truth(kind, tuple(size), pose, colour)


def cameras() -> list[Camera]:
    """The four cameras of the Panda's table."""
    fov, down = np.radians(40), (0.0, 0.0, 1.0)
    poses = [
        ("front", look_along((1.35, 0, 1.58), (-0.906, 0, -0.423), down), fov),
        ("left", look_along((-0.175, 0.2, 1.98), (0.416, -0.073, -0.906), down), fov),
        ("right", look_along((-0.175, -0.2, 1.98), (0.416, 0.073, -0.906), down), fov),
        ("wrist", look_along((0.33, -0.009, 1.50), (0, 0, -1), (1.0, 0, 0)), np.radians(60)),
    ]
    return [Camera.from_fov(f, pose, 256, 256, name) for name, pose, f in poses]


def render(truths: list[Truth], *, noise: float = 0.0, robot: Sequence[Surface] = ()) -> Observation:
    """What the cameras see of the table, the objects and the ``robot``; ``noise`` of the depth in metres."""
    rng = np.random.default_rng(0)
    board = trimesh.creation.box((1.5, 2.2, 0.04))
    surfaces = [Surface(board.vertices, board.faces, np.array(TABLE_RGB), 0)]
    surfaces += [t.surface(1 + k) for k, t in enumerate(truths)] + list(robot)
    poses = {0: rigid(translation=(0.35, 0, TABLE_TOP - 0.02))}
    poses |= {1 + k: t.pose for k, t in enumerate(truths)}
    rig, views = cameras(), []
    for camera, seen in zip(rig, RayCaster(surfaces).cast(rig, poses), strict=True):
        depth = seen.depth + rng.normal(0, noise, seen.depth.shape).astype(np.float32)
        views.append(View(camera, seen.image, depth, robot_mask=seen.ids == ROBOT_ID))
    hand = rigid([[1, 0, 0], [0, -1, 0], [0, 0, -1]], (0.28, 0, 1.47))
    return Observation(Views(tuple(views)), hand, np.zeros(7), 1.0, 0.08)
