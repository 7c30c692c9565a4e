"""Pictures without a camera: previews of the arm, and a synthetic table with three cubes for a simulated one."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import FloatArray, look_along, rigid, transform_points
from gvla2.geometry.views import View
from gvla2.planning.scene import Scene
from gvla2.robot.backend import CameraFrames
from gvla2.robot.kinematics import Kinematics
from gvla2.robot.looks import RobotLooks
from gvla2_plugins.piper import SceneryConfig
from gvla2_plugins.piper.arm import MAX_WIDTH

WOOD = (0.76, 0.61, 0.43)
COLOURS = {"red": (1.0, 0.0, 0.0), "green": (0.0, 0.5, 0.0), "blue": (0.0, 0.0, 1.0)}
SIDE = 0.04
_EYES = {"left": (0.75, 0.45, 0.65), "right": (0.75, -0.45, 0.65)}
_AT = (0.27, 0.0, 0.0)


def box_surface(size: Sequence[float], rgb: Sequence[float], identity: int = 0) -> Surface:
    """A box of full sides ``size``, metres, about its own frame's origin; ``rgb`` in [0, 1]."""
    box = trimesh.creation.box(extents=size)
    return Surface(np.asarray(box.vertices), np.asarray(box.faces), np.array(rgb), identity)


class Preview:
    """Pictures of the arm, the table and the perceived objects, from the side."""

    def __init__(self, kinematics: Kinematics, looks: RobotLooks, scene: Scene, size: int) -> None:
        self._kinematics, self._looks = kinematics, looks
        base = kinematics.world_from_base
        top = base @ rigid(translation=(0.3, 0.0, 0.0))
        top[2, 3] = scene.table_height - 0.01
        surfaces, self._poses = [box_surface((1.2, 1.2, 0.02), WOOD)], {0: top}
        for index, item in enumerate(scene.objects, 1):
            extents = np.maximum(item.extents, 1e-3)
            surfaces.append(box_surface(extents.tolist(), np.clip(item.rgb, 0.0, 1.0).tolist(), index))
            self._poses[index] = item.world_from_object
        self._caster = RayCaster(surfaces)
        eye = transform_points(base, [0.85, -0.75, 0.60])
        at = transform_points(base, [0.22, 0.0, 0.12])
        self._camera = Camera.from_fov(0.75, look_along(eye, at - eye), size, size, "preview")

    def picture(self, joints: FloatArray, width: float) -> NDArray[np.uint8]:
        """(size, size, 3) RGB at joints (6,) and an opening in metres."""
        poses = self._kinematics.link_poses(joints, width / MAX_WIDTH)
        arm = self._looks.cast([self._camera], poses)[0]
        around = self._caster.cast([self._camera], self._poses)[0]
        nearer = np.isfinite(arm.depth) & ~(around.depth < arm.depth)
        return np.where(nearer[..., None], arm.image, around.image)


class Scenery:
    """Implements :class:`gvla2.robot.backend.DepthCamera`; nothing in it ever moves, and the arm is not in it."""

    def __init__(self, config: SceneryConfig) -> None:
        if config.image_size <= 0:
            raise ConfigurationError(f"camera.image_size={config.image_size} must be above 0.")
        rng = np.random.default_rng(config.seed)
        top = config.table_height
        surfaces = [box_surface((1.0, 1.2, 0.02), WOOD)]
        poses = {0: rigid(translation=(0.35, 0.0, top - 0.01))}
        for index, rgb in enumerate(COLOURS.values()):
            surfaces.append(box_surface((SIDE,) * 3, rgb, index + 1))
            place = (rng.uniform(0.22, 0.30), 0.14 * (index - 1) + rng.uniform(-0.03, 0.03), top + 0.5 * SIDE)
            poses[index + 1] = rigid(Rotation.from_euler("z", rng.uniform(-0.6, 0.6)).as_matrix(), place)
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
