"""Colour, depth and identity images of rigid triangle surfaces, on the CPU.

A pixel shows the nearest triangle on the ray through its centre. Triangles are drawn one by one over the pixels they
may cover, and a depth buffer keeps the nearest: an image takes milliseconds, and posing a surface rebuilds nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.compiled import compiled
from gvla2.geometry.mesh import Texture, TriangleMesh
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid, transform_points

AMBIENT = 0.55
"""Ambient share of a colour; the rest grows with the light, so hue never changes."""
HEADLIGHT, SKY = 0.6, 0.4
"""Shares of light from the camera's lamp (along its axis) and the sky (world +z)."""
BACKGROUND = (0.80, 0.84, 0.88)

_NEAR = 1e-3  # metres before a camera, up to which a triangle's corners are projected
_CENTRE, _PAST = 0.5 + 1e-9, 0.5 - 1e-9  # of a pixel, no centre on a triangle's edge lost to rounding


@dataclass(frozen=True)
class Surface:
    """One rigid triangle surface.

    ``vertices`` (V, 3) in metres, in the surface's own frame; ``faces`` (F, 3) vertex indices; ``rgb`` (3,) or
    (F, 3) in [0, 1]; ``id`` is what the identity image shows, >= 0, and need not be unique (the links of one
    robot may share it). F = 0 is allowed and never hit, nor are faces without area. ``texture`` multiplies the
    faces' colours.
    Raises :class:`GeometryError` for wrong shapes, non-finite vertices, or faces that name absent vertices.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    rgb: FloatArray
    id: int
    texture: Texture | None = None

    def __post_init__(self) -> None:
        faces, rgb = np.asarray(self.faces, dtype=np.int64), np.asarray(self.rgb, dtype=np.float64)
        try:
            mesh = TriangleMesh(self.vertices, faces if faces.size else faces.reshape(-1, 3))
        except GeometryError as error:
            raise GeometryError(f"Surface {self.id}: {error}") from error
        count = len(mesh.faces)
        if rgb.shape not in ((3,), (count, 3)) or not ((rgb >= 0) & (rgb <= 1)).all():
            raise GeometryError(
                f"Surface {self.id}: rgb must be (3,) or (F, 3) in [0, 1], got shape {rgb.shape}."
            )
        if self.id < 0 or (self.texture is not None and len(self.texture.uv) != count):
            raise GeometryError(
                f"Surface {self.id}: ids start at 0 (-1 is background); textures have {count} faces."
            )
        for name, value in (("vertices", mesh.vertices), ("faces", mesh.faces), ("rgb", rgb)):
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class RayImage:
    """What one camera sees.

    ``image`` (H, W, 3) uint8 RGB; ``depth`` (H, W) float32, metres along the camera's z, NaN where no surface
    is; ``ids`` (H, W) int32, the surface's id, -1 for background.
    """

    image: NDArray[np.uint8]
    depth: NDArray[np.float32]
    ids: NDArray[np.int32]


class RayCaster:
    """Casts the pixels' rays of pinhole cameras against posed surfaces.

    One colour seen at different slopes differs in brightness by at most 45 %, never in hue or saturation:
    image = rgb * (0.55 + 0.45 * light), light = 0.6 |n . camera axis| + 0.4 (1 + n_z) / 2, without shadows.
    Depth is right to about 1e-7 of the distance (the image's float32).
    """

    def __init__(
        self, surfaces: Sequence[Surface], background: tuple[float, float, float] = BACKGROUND
    ) -> None:
        self._surfaces = tuple(surfaces)
        self._background = _as_bytes(np.array(background, dtype=np.float64))
        self._first_faces = np.cumsum([0] + [len(s.faces) for s in self._surfaces])
        # All faces' unit normals n and offsets n . x, in the surfaces' frames; 0 for a face without area.
        normals = [TriangleMesh(s.vertices, s.faces).normals for s in self._surfaces]
        firsts = [s.vertices[s.faces[:, 0]] for s in self._surfaces]
        self._normals = np.concatenate([np.zeros((0, 3)), *normals])
        self._plane_offsets = np.einsum(
            "ij,ij->i", self._normals, np.concatenate([np.zeros((0, 3)), *firsts])
        )
        self._rgb = np.concatenate(
            [np.broadcast_to(s.rgb, (len(s.faces), 3)) for s in self._surfaces] or [np.zeros((0, 3))]
        ).astype(np.float32)
        self._ids = np.repeat([s.id for s in self._surfaces], np.diff(self._first_faces)).astype(np.int32)

    def cast(self, cameras: Sequence[Camera], world_from_surface: Mapping[int, ArrayLike]) -> list[RayImage]:
        """One image a camera, with surfaces posed by their index in the sequence given at construction.

        ``world_from_surface`` (4, 4) rigid; a surface without a pose lies at the world's origin.
        Raises :class:`GeometryError` for a pose that is not rigid or names no surface.
        """
        unknown = [index for index in world_from_surface if not 0 <= index < len(self._surfaces)]
        if unknown:
            raise GeometryError(f"Poses of surfaces {unknown}, but there are {len(self._surfaces)} (from 0).")
        poses = [np.eye(4)] * len(self._surfaces)
        for i, pose in world_from_surface.items():
            poses[i] = check_rigid(pose, f"Pose of surface {i}")
        return [self._cast_one(camera, poses) for camera in cameras]

    def _cast_one(self, camera: Camera, poses: Sequence[FloatArray]) -> RayImage:
        size = (camera.height, camera.width)
        depth = np.full(size, np.inf, dtype=np.float32)
        hits = np.full(size, len(self._ids), dtype=np.int64)  # one past the last face: background
        # Near surfaces first, so that what they hide is dropped early.
        for index in np.argsort([np.linalg.norm(pose[:3, 3] - camera.position) for pose in poses]):
            surface = self._surfaces[index]
            camera_from_surface = invert_rigid(camera.world_from_camera) @ poses[index]
            seen = transform_points(camera_from_surface, surface.vertices) @ camera.K.T
            draw(np.ascontiguousarray(seen), surface.faces, int(self._first_faces[index]), depth, hits)
        shown = np.zeros(len(self._ids) + 1, dtype=bool)
        shown[hits] = True
        faces = np.flatnonzero(shown[:-1])
        shades = self._shades(camera, poses, faces)
        colours = np.empty((len(shown), 3), dtype=np.uint8)
        colours[faces] = _as_bytes(self._rgb[faces] * shades[faces, None])
        colours[-1] = self._background
        ids = np.append(self._ids, np.int32(-1))
        depth[np.isinf(depth)] = np.nan
        image = np.take(colours, hits, axis=0)
        for index, surface in enumerate(self._surfaces):
            if surface.texture is None:
                continue
            first = self._first_faces[index]
            rows, columns = np.nonzero((hits >= first) & (hits < first + len(surface.faces)))
            distance = depth[rows, columns].astype(np.float64)
            pixels = np.column_stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
            points = transform_points(
                camera.world_from_camera, pixels @ np.linalg.inv(camera.K).T * distance[:, None]
            )
            shown = hits[rows, columns] - first
            points = transform_points(invert_rigid(poses[index]), points)
            weights = barycentric(surface.vertices, surface.faces[shown], points)
            seen = surface.texture.at(shown, weights, distance / camera.K[0, 0])
            shade = shades[first + shown][:, None]
            image[rows, columns] = _as_bytes(self._rgb[first + shown] * seen * shade)
        return RayImage(image, depth, np.take(ids, hits))

    def _shades(
        self, camera: Camera, poses: Sequence[FloatArray], faces: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        """(F,) brightness of ``faces`` (n,), in order, 0 of others; the side that faces the camera counts."""
        shades = np.zeros(len(self._ids), dtype=np.float32)
        ends = np.searchsorted(faces, self._first_faces)
        for pose, start, stop in zip(poses, ends[:-1], ends[1:], strict=True):
            some = faces[start:stop]
            normals = self._normals[some] @ pose[:3, :3].T
            seen_from_front = normals @ (camera.position - pose[:3, 3]) >= self._plane_offsets[some]
            sky = 0.5 + 0.5 * np.where(seen_from_front, normals[:, 2], -normals[:, 2])
            headlight = np.abs(normals @ camera.world_from_camera[:3, 2])
            shades[some] = AMBIENT + (1 - AMBIENT) * (HEADLIGHT * headlight + SKY * sky)
        return shades


def barycentric(vertices: FloatArray, faces: NDArray[np.int64], points: FloatArray) -> FloatArray:
    """(N, 3) weights of the corners of faces (N, 3), indices of vertices (V, 3), at points (N, 3) on them."""
    weights = np.clip(
        trimesh.triangles.points_to_barycentric(vertices[faces], points, method="cross"), 0.0, 1.0
    )
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _as_bytes(rgb: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.asarray(np.clip(np.rint(255 * rgb), 0, 255), dtype=np.uint8)


@compiled
def draw(
    corners: FloatArray,
    faces: NDArray[np.int64],
    first_face: int,
    depth: NDArray[np.float32],
    hits: NDArray[np.int64],
    farthest: bool = False,
) -> None:
    """Draw faces into ``depth`` (H, W) and ``hits`` (``first_face`` plus the face's number) where they are nearer,
    or with ``farthest`` where they are farther.

    ``corners`` (V, 3) are the vertices in the camera's frame times K: (u z, v z, z). A pixel centre (u, v, 1) lies in
    the triangle a, b, c where its products with b x c, c x a and a x b have one sign, also where the triangle reaches
    behind the camera; two triangles get opposite products from a common edge, so that no pixel slips between them.
    """
    height, width = depth.shape
    for face in range(len(faces)):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = corners[i, 0], corners[i, 1], corners[i, 2]
        bx, by, bz = corners[j, 0], corners[j, 1], corners[j, 2]
        cx, cy, cz = corners[k, 0], corners[k, 1], corners[k, 2]
        if max(az, bz, cz) <= _NEAR:
            continue
        left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
        for x, y, z, to_x, to_y, to_z in (
            (ax, ay, az, bx, by, bz),
            (bx, by, bz, cx, cy, cz),
            (cx, cy, cz, ax, ay, az),
        ):
            if (z > _NEAR) != (to_z > _NEAR):  # the side passes the camera's plane: it ends there
                share = (_NEAR - z) / (to_z - z)
                u, v = (x + share * (to_x - x)) / _NEAR, (y + share * (to_y - y)) / _NEAR
                left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
            if z > _NEAR:
                u, v = x / z, y / z
                left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
        first, last = int(np.ceil(max(0.0, left - _CENTRE))), int(np.floor(min(width, right + _PAST)))
        upper, lower = int(np.ceil(max(0.0, top - _CENTRE))), int(np.floor(min(height, bottom + _PAST)))
        if first >= last or upper >= lower:  # it lies between the centres of pixels: most small ones do
            continue
        ox, oy, oz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        px, py, pz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
        qx, qy, qz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        volume = ax * ox + ay * oy + az * oz
        for row in range(upper, lower):
            v = row + 0.5
            o_row, p_row, q_row = oy * v + oz, py * v + pz, qy * v + qz
            for column in range(first, last):
                u = column + 0.5
                o, p, q = ox * u + o_row, px * u + p_row, qx * u + q_row
                if not ((o >= 0.0 and p >= 0.0 and q >= 0.0) or (o <= 0.0 and p <= 0.0 and q <= 0.0)):
                    continue
                total = o + p + q
                if total == 0.0:
                    continue
                distance = volume / total
                before = depth[row, column]
                if distance > 0.0 and (distance > before if farthest else distance < before):
                    depth[row, column] = distance
                    hits[row, column] = first_face + face
