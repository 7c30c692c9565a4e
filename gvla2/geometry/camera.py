"""A calibrated pinhole camera: projection, back-projection, rays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid, rigid, transform_points


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in the OpenCV convention (x right, y down, z forward).

    ``K`` (3, 3) in pixels, principal point measured from the image's upper left corner (the first pixel's
    centre is (0.5, 0.5)); ``world_from_camera`` (4, 4), metres; ``width`` and ``height`` in pixels.
    Raises :class:`GeometryError` for a singular K, a non-finite entry, or a pose that is not a rigid motion
    (a mirrored camera, determinant -1, is named as such).
    """

    K: FloatArray
    world_from_camera: FloatArray
    width: int
    height: int
    name: str = "camera"

    def __post_init__(self) -> None:
        K = np.asarray(self.K, dtype=np.float64)
        if K.shape != (3, 3) or not np.isfinite(K).all():
            raise GeometryError(f"Camera '{self.name}': K must be a finite 3x3 matrix, got shape {K.shape}.")
        if abs(np.linalg.det(K)) < 1e-9 or K[0, 0] <= 0 or K[1, 1] <= 0:
            raise GeometryError(f"Camera '{self.name}': K is singular or has a focal length <= 0:\n{K}")
        if self.width <= 0 or self.height <= 0:
            raise GeometryError(f"Camera '{self.name}': image size {self.width}x{self.height} is empty.")
        pose = check_rigid(self.world_from_camera, what=f"Camera '{self.name}': world_from_camera")
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "world_from_camera", pose)

    @classmethod
    def from_fov(
        cls, fov_y: float, world_from_camera: FloatArray, width: int, height: int, name: str = "camera"
    ) -> Camera:
        """Camera with square pixels, a centred principal point and a vertical field of view in radians."""
        focal = 0.5 * height / np.tan(0.5 * fov_y)
        K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
        return cls(K, world_from_camera, width, height, name)

    @classmethod
    def from_opengl(
        cls, fov_y: float, world_from_camera: FloatArray, width: int, height: int, name: str = "camera"
    ) -> Camera:
        """As :meth:`from_fov`, with the pose as OpenGL and simulators that draw by it have it: x right, y up, looking
        along -z; in single precision, too.
        """
        u, _, v = np.linalg.svd(world_from_camera[:3, :3] @ np.diag([1.0, -1.0, -1.0]))
        return cls.from_fov(fov_y, rigid(u @ v, world_from_camera[:3, 3]), width, height, name)

    @property
    def camera_from_world(self) -> FloatArray:
        """(4, 4) extrinsic matrix T of the paper."""
        return invert_rigid(self.world_from_camera)

    @property
    def position(self) -> FloatArray:
        """(3,) optical centre in the world, metres."""
        return self.world_from_camera[:3, 3]

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project world points (..., 3) to pixels (..., 2) and depths (...); equation pi_i(p) of the paper.

        Points on or behind the camera plane get NaN pixels; their depth is returned unchanged.
        """
        local = transform_points(self.camera_from_world, points)
        depth = local[..., 2]
        image = local @ self.K.T
        with np.errstate(divide="ignore", invalid="ignore"):
            uv = np.where(depth[..., None] > 0, image[..., :2] / image[..., 2:3], np.nan)
        return uv, depth

    def inside(self, uv: NDArray[np.floating]) -> np.ndarray:
        """(...,) bool: which pixels (..., 2) fall inside the image; NaN is outside."""
        u, v = uv[..., 0], uv[..., 1]
        return np.asarray((u >= 0) & (u < self.width) & (v >= 0) & (v < self.height))

    def pixel_centres(self) -> FloatArray:
        """(height, width, 2) pixel centres as (u, v)."""
        return _centres(self.width, self.height)

    def rays(self) -> tuple[FloatArray, FloatArray]:
        """World rays of all pixel centres: origin (3,) and directions (height, width, 3) with camera z = 1.

        A direction times a depth, added to the origin, is the back-projected point.
        """
        local = _rays_before(self.K.tobytes(), self.width, self.height)
        return self.position, local @ self.world_from_camera[:3, :3].T

    def backproject(self, depth: FloatArray) -> FloatArray:
        """World points (height, width, 3) of a depth map (height, width); NaN depth gives NaN points."""
        depth = np.asarray(depth, dtype=np.float64)
        if depth.shape != (self.height, self.width):
            raise GeometryError(
                f"Camera '{self.name}' is {self.width}x{self.height}, but the depth map has shape {depth.shape}."
            )
        origin, directions = self.rays()
        return origin + directions * depth[..., None]


def _centres(width: int, height: int) -> FloatArray:
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([u, v], axis=-1)


@lru_cache(maxsize=8)
def _rays_before(K: bytes, width: int, height: int) -> FloatArray:
    """(height, width, 3) :meth:`Camera.rays` in the camera's frame; a scene's cameras mostly have one K."""
    pixels = _centres(width, height)
    homogeneous = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    return np.asarray(homogeneous @ np.linalg.inv(np.frombuffer(K).reshape(3, 3)).T)
