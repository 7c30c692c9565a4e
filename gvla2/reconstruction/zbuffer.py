"""Depth maps of triangle meshes: what is visible from where"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.reconstruction.compiled import compiled, run_together
from gvla2.reconstruction.mask_distance import Silhouette, mask_iou

NEAREST = 1e-3
"""Metres in front of a camera's plane within which nothing is drawn."""


def depth_map(mesh: TriangleMesh, camera: Camera, farthest: bool = False) -> NDArray[np.float32]:
    """(H, W) float32 depth along the camera's z of the nearest surface at each pixel's centre, inf where none is.

    ``farthest`` takes the farthest surface instead, -inf where none is. Triangles that reach nearer than
    :data:`NEAREST` to the camera's plane are left out.
    """
    depth = np.full((camera.height, camera.width), -np.inf if farthest else np.inf, dtype=np.float32)
    local = transform_points(camera.camera_from_world, mesh.vertices)
    image = local @ camera.K.T
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = image[:, :2] / image[:, 2:3]
    _rasterise(np.ascontiguousarray(uv), np.ascontiguousarray(local[:, 2]), mesh.faces, depth, farthest)
    return depth


def depth_maps(
    mesh: TriangleMesh, cameras: Sequence[Camera], farthest: bool = False
) -> list[NDArray[np.float32]]:
    """The same of several cameras."""
    return run_together([partial(depth_map, mesh, camera, farthest) for camera in cameras])


def mask_agreement(mesh: TriangleMesh, silhouettes: Sequence[Silhouette]) -> float:
    """Mean IoU of the mesh's silhouettes with the views' masks."""
    depths = depth_maps(mesh, [s.camera for s in silhouettes])
    return float(np.mean([mask_iou(np.isfinite(d), s) for d, s in zip(depths, silhouettes, strict=True)]))


@compiled
def _rasterise(
    uv: FloatArray,
    z: FloatArray,
    faces: NDArray[np.int64],
    depth: NDArray[np.float32],
    farthest: bool,
) -> None:
    height, width = depth.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if not (z[a] >= NEAREST and z[b] >= NEAREST and z[c] >= NEAREST):
            continue
        ax, ay, bx, by, cx, cy = uv[a, 0], uv[a, 1], uv[b, 0], uv[b, 1], uv[c, 0], uv[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not abs(area) > 0.0:
            continue
        # Pixel i's centre lies at i + 0.5.
        left = max(int(np.ceil(max(min(ax, bx, cx), 0.0) - 0.5)), 0)
        right = min(int(np.floor(min(max(ax, bx, cx), width) - 0.5)), width - 1)
        top = max(int(np.ceil(max(min(ay, by, cy), 0.0) - 0.5)), 0)
        bottom = min(int(np.floor(min(max(ay, by, cy), height) - 0.5)), height - 1)
        ia, ib, ic = 1 / z[a], 1 / z[b], 1 / z[c]
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                wa = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                wb = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                wc = 1.0 - wa - wb
                if wa >= -1e-9 and wb >= -1e-9 and wc >= -1e-9:
                    # Its inverse, not depth itself, is linear in the image.
                    d = 1.0 / (wa * ia + wb * ib + wc * ic)
                    depth[row, column] = (
                        max(depth[row, column], d) if farthest else min(depth[row, column], d)
                    )
