"""A synthetic table with three cubes in place of a camera."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import FloatArray, look_along, rigid
from gvla2.geometry.views import View
from gvla2.robot.backend import CameraFrames

WOOD = (0.76, 0.61, 0.43)
COLOURS = {"red": (1.0, 0.0, 0.0), "green": (0.0, 0.5, 0.0), "blue": (0.0, 0.0, 1.0)}
SIDE = 0.04
_EYES = {"left": (0.75, 0.45, 0.65), "right": (0.75, -0.45, 0.65)}
_AT = (0.27, 0.0, 0.0)


def box_surface(size: Sequence[float], rgb: Sequence[float], identity: int = 0) -> Surface:
    """A box of full sides ``size``, metres, about its own frame's origin; ``rgb`` in [0, 1]."""
    box = trimesh.creation.box(extents=size)
    return Surface(np.asarray(box.vertices), np.asarray(box.faces), np.array(rgb), identity)


class Scenery:
    """Implements :class:`gvla2.robot.backend.DepthCamera`; nothing in it ever moves, and the arm is not in it."""

    def __init__(self, image_size: int = 256) -> None:
        rng = np.random.default_rng(0)
        surfaces = [box_surface((1.0, 1.2, 0.02), WOOD)]
        poses = {0: rigid(translation=(0.35, 0.0, -0.01))}
        for index, rgb in enumerate(COLOURS.values()):
            surfaces.append(box_surface((SIDE,) * 3, rgb, index + 1))
            place = (rng.uniform(0.22, 0.30), 0.14 * (index - 1) + rng.uniform(-0.03, 0.03), 0.5 * SIDE)
            poses[index + 1] = rigid(Rotation.from_euler("z", rng.uniform(-0.6, 0.6)).as_matrix(), place)
        cameras = [
            Camera.from_fov(0.7, look_along(eye, np.subtract(_AT, eye)), image_size, image_size, name)
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
