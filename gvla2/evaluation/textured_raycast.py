"""Pictures of a textured mesh by ray casting on the CPU: anti-aliased colour and alpha, exact depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from gvla2.evaluation.texturing import paint
from gvla2.geometry.camera import Camera
from gvla2.geometry.textured_mesh import TexturedMesh
from gvla2.geometry.transform import transform_points
from gvla2.geometry.views import View

LIGHT = np.array([0.3, -0.4, 0.866])
"""Direction towards the light, fixed in the world: a point looks the same from all sides."""
AMBIENT, DIFFUSE = 0.8, 0.2
"""shade = AMBIENT + DIFFUSE * (normal . light), in [0.6, 1]: enough to see the shape of a plain object."""

_CHUNK = 16384  # rays a call: the answer's arrays then stay in the cache


@dataclass(frozen=True)
class _Hits:
    """Rays that met the mesh: index of the ray, face, barycentric coordinates of corners 1 and 2, depth."""

    ray: NDArray[np.int64]
    face: NDArray[np.int32]
    u: NDArray[np.float32]
    v: NDArray[np.float32]
    depth: NDArray[np.float32]


class TexturedCaster:
    """Casts rays against one textured mesh that lies in the world's frame.

    Colour is the texture (bilinear, in the file's own gamma) under a mild light fixed in the world, so that views
    agree; faces are seen from both sides; the background is white.
    """

    def __init__(self, textured: TexturedMesh) -> None:
        # All images one after the other, and where each starts: (start, height, width).
        starts = np.cumsum([0] + [image.size for image in textured.images])
        shapes = [(start, *image.shape[:2]) for start, image in zip(starts, textured.images, strict=False)]
        self._paint = (
            np.ascontiguousarray(textured.uv, dtype=np.float32),
            np.ascontiguousarray(textured.rgb, dtype=np.float32),
            np.ascontiguousarray(textured.texture, dtype=np.int64),
            np.concatenate([image.ravel() for image in textured.images] or [np.zeros(0, dtype=np.uint8)]),
            np.array(shapes, dtype=np.int64).reshape(-1, 3),
        )
        mesh = textured.mesh
        self._device = EmbreeDevice()
        # Without "robust", a ray that meets the edge of two triangles may slip between them.
        self._tree = EmbreeScene(self._device, robust=True)
        TriangleMesh(self._tree, mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
        low, high = mesh.bounds
        self._corners = np.array(
            [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        )
        self._normals = mesh.normals
        self._offsets = np.einsum("ij,ij->i", self._normals, mesh.vertices[mesh.faces[:, 0]])
        self._light = LIGHT / np.linalg.norm(LIGHT)

    def view(self, camera: Camera, samples: int = 4) -> View:
        """One picture with ``samples`` x ``samples`` rays a pixel.

        The view's mask is alpha, the share of a pixel's rays that hit; its depth (metres along the camera's z)
        is that of the ray through the pixel's centre, NaN where this ray misses.
        """
        size = (camera.height, camera.width)
        sums = np.zeros((size[0] * size[1], 4))  # red, green, blue, hits
        depth = np.full(size[0] * size[1], np.nan, dtype=np.float32)
        shades = self._shades(camera)
        for pixels, hits in self._cast(camera, samples):
            paint(hits.face, hits.u, hits.v, pixels[hits.ray], shades, *self._paint, sums)
        for pixels, hits in self._cast(camera, 1):
            depth[pixels[hits.ray]] = hits.depth
        sums /= samples * samples
        alpha = sums[:, 3]
        image = sums[:, :3] + (1 - alpha)[:, None]
        return View(
            camera,
            np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8).reshape(*size, 3),
            depth.reshape(size),
            alpha.astype(np.float32).reshape(size),
        )

    def _cast(self, camera: Camera, samples: int) -> Iterator[tuple[NDArray[np.int64], _Hits]]:
        """Chunks of rays: the pixel that each belongs to, and the hits."""
        rows, columns = self._window(camera)
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return
        world_from_pixel = camera.world_from_camera[:3, :3] @ np.linalg.inv(camera.K)
        origin = camera.position.astype(np.float32)
        u = columns.start + (np.arange((columns.stop - columns.start) * samples) + 0.5) / samples
        along_row = u[:, None] * world_from_pixel[:, 0] + world_from_pixel[:, 2]
        column_of = np.floor(u).astype(np.int64)
        step = max(1, _CHUNK // len(u))
        lines = np.arange((rows.stop - rows.start) * samples)
        for start in range(0, len(lines), step):
            v = rows.start + (lines[start : start + step] + 0.5) / samples
            # z = 1 in the camera's frame: a ray's length is its depth.
            rays = (v[:, None, None] * world_from_pixel[:, 1] + along_row).astype(np.float32).reshape(-1, 3)
            pixels = (np.floor(v).astype(np.int64)[:, None] * camera.width + column_of).ravel()
            answer = self._tree.run(np.tile(origin, (len(rays), 1)), rays, output=True)
            hit = np.flatnonzero(answer["primID"] >= 0)
            if len(hit):
                found = (answer[name][hit] for name in ("primID", "u", "v", "tfar"))
                yield pixels, _Hits(hit, *found)

    def _window(self, camera: Camera) -> tuple[slice, slice]:
        """Rows and columns that may see the mesh; the whole image when it reaches behind the camera."""
        local = transform_points(camera.camera_from_world, self._corners) @ camera.K.T
        if (local[:, 2] <= 1e-3).any():
            return slice(0, camera.height), slice(0, camera.width)
        uv = local[:, :2] / local[:, 2:]
        limits = (camera.width, camera.height)
        low = np.clip(np.floor(uv.min(axis=0)), 0, limits).astype(int)
        high = np.clip(np.ceil(uv.max(axis=0)), 0, limits).astype(int)
        return slice(low[1], high[1]), slice(low[0], high[0])

    def _shades(self, camera: Camera) -> NDArray[np.float64]:
        """(F,) shade of each face; the side that faces the camera counts, however a face is wound."""
        towards = np.where(self._normals @ camera.position >= self._offsets, 1.0, -1.0)
        return np.asarray(AMBIENT + DIFFUSE * towards * (self._normals @ self._light))
