"""Pictures of a textured mesh for measurements: anti-aliased colour and alpha, exact depth."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import TexturedMesh, TriangleMesh, bilinear
from gvla2.geometry.raycast import barycentric, draw
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.geometry.views import View

LIGHT = np.array([0.3, -0.4, 0.866])
"""Direction towards the light, fixed in the world: a point looks the same from all sides."""
AMBIENT, DIFFUSE = 0.8, 0.2
"""shade = AMBIENT + DIFFUSE * (normal . light), in [0.6, 1]: enough to see the shape of a plain object."""


def textured_view(textured: TexturedMesh, camera: Camera, samples: int = 4) -> View:
    """One picture of a mesh as it lies in the world, with ``samples`` x ``samples`` rays a pixel.

    Colour is the texture (bilinear, in the file's own gamma) under a mild light fixed in the world, so that views
    agree; faces are seen from both sides; the background is white. The view's mask is alpha, the share of a pixel's
    rays that hit; its depth (metres along the camera's z) is that of the ray through the pixel's centre, NaN where
    this ray misses.
    """
    mesh = textured.mesh
    local = transform_points(camera.camera_from_world, mesh.vertices)
    shades = _shades(mesh, camera)
    sums = np.zeros((camera.height, camera.width, 4))  # red, green, blue, hits
    offsets = (np.arange(samples) + 0.5) / samples - 0.5  # pixels from the centre of one
    for down, right in product(offsets, repeat=2):
        K = camera.K - [[0, 0, right], [0, 0, down], [0, 0, 0]]
        depth, hits = _seen(local, mesh.faces, K, camera)
        rows, columns = np.nonzero(np.isfinite(depth))
        faces, distance = hits[rows, columns], depth[rows, columns, None].astype(np.float64)
        points = (
            np.column_stack([columns + 0.5, rows + 0.5, np.ones(len(rows))]) @ np.linalg.inv(K).T * distance
        )
        weights = barycentric(local, mesh.faces[faces], points)
        sums[rows, columns, :3] += shades[faces, None] * _colours(textured, faces, weights)
        sums[rows, columns, 3] += 1
    sums /= samples * samples
    alpha = sums[..., 3]
    image = np.rint(255 * np.clip(sums[..., :3] + (1 - alpha)[..., None], 0, 1)).astype(np.uint8)
    depth, _ = _seen(local, mesh.faces, camera.K, camera)
    return View(camera, image, np.where(np.isfinite(depth), depth, np.nan), alpha.astype(np.float32))


def _seen(
    local: FloatArray, faces: NDArray[np.int64], K: FloatArray, camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """(H, W) depth, inf where nothing is, and the face seen; ``local`` (V, 3) are vertices in the camera's frame."""
    depth = np.full((camera.height, camera.width), np.inf, dtype=np.float32)
    hits = np.zeros(depth.shape, dtype=np.int64)
    draw(np.ascontiguousarray(local @ K.T), faces, 0, depth, hits)
    return depth, hits


def _colours(textured: TexturedMesh, faces: NDArray[np.int64], weights: FloatArray) -> FloatArray:
    """(N, 3) colours in [0, 1] at barycentric ``weights`` (N, 3) of faces (N,): the corners' times the texture's."""
    colours: FloatArray = np.einsum("nk,nkc->nc", weights, textured.rgb[faces])
    uv = np.einsum("nk,nkc->nc", weights, textured.uv[faces])
    # Only what leaves [0, 1] repeats: at exactly 1 the image's own border is meant.
    uv = np.where((uv < 0) | (uv > 1), uv - np.floor(uv), uv)
    for number, image in enumerate(textured.images):
        mine = textured.texture[faces] == number
        colours[mine] *= bilinear(image, uv[mine]) / 255
    return colours


def _shades(mesh: TriangleMesh, camera: Camera) -> FloatArray:
    """(F,) shade of each face; the side that faces the camera counts, however a face is wound."""
    normals = mesh.normals
    towards = np.einsum("ij,ij->i", normals, camera.position - mesh.vertices[mesh.faces[:, 0]])
    return np.asarray(
        AMBIENT + DIFFUSE * np.where(towards >= 0, 1.0, -1.0) * (normals @ LIGHT) / np.linalg.norm(LIGHT)
    )
