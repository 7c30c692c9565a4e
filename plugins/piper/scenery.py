"""A synthetic table with three cubes, seen by two cameras, for a simulated arm."""

from __future__ import annotations

import time

import numpy as np
import trimesh

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import FloatArray, look_along, rigid
from gvla2.geometry.views import View
from gvla2.robot.backend import CameraFrames
from gvla2_plugins.piper import SceneryConfig
from gvla2_plugins.piper.dh import turn_z

COLOURS = {"red": (1.0, 0.0, 0.0), "green": (0.0, 0.5, 0.0), "blue": (0.0, 0.0, 1.0)}
SIDE = 0.04
_EYES = {"left": (0.75, 0.45, 0.65), "right": (0.75, -0.45, 0.65)}
_AT = (0.27, 0.0, 0.0)


class Scenery:
    """Implements :class:`gvla2.robot.backend.DepthCamera`; nothing in it ever moves, and the arm is not in it."""

    def __init__(self, config: SceneryConfig) -> None:
        if config.image_size <= 0:
            raise ConfigurationError(f"camera.image_size={config.image_size} must be above 0.")
        rng = np.random.default_rng(config.seed)
        top = config.table_height
        table = trimesh.creation.box(extents=(1.0, 1.2, 0.02))
        cube = trimesh.creation.box(extents=(SIDE,) * 3)
        surfaces = [
            Surface(np.asarray(table.vertices), np.asarray(table.faces), np.array((0.76, 0.61, 0.43)), 0)
        ]
        poses = {0: rigid(translation=(0.35, 0.0, top - 0.01))}
        for index, rgb in enumerate(COLOURS.values()):
            surfaces.append(
                Surface(np.asarray(cube.vertices), np.asarray(cube.faces), np.array(rgb), index + 1)
            )
            place = (rng.uniform(0.22, 0.30), 0.14 * (index - 1) + rng.uniform(-0.03, 0.03), top + 0.5 * SIDE)
            poses[index + 1] = rigid(turn_z(rng.uniform(-0.6, 0.6)), place)
        cameras = [
            Camera.from_fov(0.7, look_along(eye, np.subtract(_AT, eye)), *(config.image_size,) * 2, name)
            for name, eye in _EYES.items()
        ]
        images = RayCaster(surfaces).cast(cameras, poses)
        self._views = tuple(
            View(camera, image.image, image.depth) for camera, image in zip(cameras, images, strict=True)
        )

    @property
    def live(self) -> bool:
        """False: its pictures are synthetic."""
        return False

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """The same two views every time."""
        return CameraFrames(self._views, (time.time(),) * len(self._views))

    def close(self) -> None:
        """Nothing is open."""
