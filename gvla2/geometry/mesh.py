"""Triangle meshes, with the images on their surface."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import map_coordinates

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray

GREY = 0.7
"""The colour of a mesh that has none."""
LEVELS = 7
"""Levels of a texture's pyramid: from the image's own texels to 64 of them in one."""
UNUSED = 1e-4
"""Weight in a mean of a texel that no face uses."""


@dataclass(frozen=True)
class TriangleMesh:
    """A triangle mesh in the world's or an object's frame.

    ``vertices`` (V, 3) metres; ``faces`` (F, 3) vertex indices, counter-clockwise seen from outside;
    ``colours`` (V, 3) RGB in [0, 1], or None. Faces without area are kept; their normal is zero and no sample
    falls on them. Raises :class:`GeometryError` for wrong shapes, vertices that are not finite, and faces that
    name absent vertices.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    colours: FloatArray | None = None

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, dtype=np.float64)
        faces = np.asarray(self.faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise GeometryError(f"Mesh: vertices must be (V, 3), got shape {vertices.shape}.")
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise GeometryError(f"Mesh: faces must be (F, 3), got shape {faces.shape}; triangulate it first.")
        if not np.isfinite(vertices).all():
            count = int((~np.isfinite(vertices).all(axis=1)).sum())
            raise GeometryError(f"Mesh: {count} of {len(vertices)} vertices are not finite.")
        if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise GeometryError(f"Mesh: a face names a vertex outside 0..{len(vertices) - 1}.")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        if self.colours is not None:
            colours = np.asarray(self.colours, dtype=np.float64)
            if colours.shape != vertices.shape or not ((colours >= 0) & (colours <= 1)).all():
                raise GeometryError(f"Mesh: colours must be (V, 3) in [0, 1], got shape {colours.shape}.")
            object.__setattr__(self, "colours", colours)

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) lowest and highest coordinates of the vertices, metres; an error for an empty mesh."""
        if len(self.vertices) == 0:
            raise GeometryError("A mesh without vertices has no bounds.")
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def areas(self) -> FloatArray:
        """(F,) square metres."""
        return np.asarray(0.5 * np.linalg.norm(self._crosses(), axis=1))

    @property
    def normals(self) -> FloatArray:
        """(F, 3) unit normals of the faces; zero where a face has no area."""
        crosses = self._crosses()
        length = np.linalg.norm(crosses, axis=1, keepdims=True)
        return np.asarray(np.divide(crosses, length, out=np.zeros_like(crosses), where=length > 0))

    def _crosses(self) -> FloatArray:
        """(F, 3) face normals as long as twice the face's area."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return np.asarray(np.cross(b - a, c - a), dtype=np.float64)

    def sample(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, NDArray[np.int64]]:
        """Points (count, 3) uniform over the surface, metres, and the face (count,) that each lies on.

        Raises :class:`GeometryError` when no face has an area.
        """
        faces, weights = self.draw(count, rng)
        return self.points_at(faces, weights), faces

    def draw(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Faces (count,) and barycentric weights (count, 3) of points uniform over the surface; errors as `sample`."""
        areas = self.areas
        total = areas.sum()
        if not total > 0:
            raise GeometryError(
                f"No face of the mesh has an area ({len(self.faces)} faces): nothing to sample."
            )
        chosen = rng.choice(len(areas), size=count, p=areas / total)
        # The square root makes the triangle's far side as dense as its tip (Osada et al. 2002, eq. 1).
        u, v = np.sqrt(rng.random(count)), rng.random(count)
        return chosen, np.stack([1 - u, u * (1 - v), u * v], axis=1)

    def points_at(self, faces: NDArray[np.int64], weights: FloatArray) -> FloatArray:
        """(N, 3) points at barycentric ``weights`` (N, 3) on ``faces`` (N,), metres."""
        a, b, c = (self.vertices[self.faces[faces, k]] for k in range(3))
        return np.asarray(weights[:, :1] * a + weights[:, 1:2] * b + weights[:, 2:] * c)

    @property
    def volume(self) -> float:
        """Cubic metres within a closed surface, negative where its faces are wound inside out."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)

    def clustered(self, cell: float) -> tuple[TriangleMesh, NDArray[np.int64]]:
        """The mesh with the vertices of each cube of side ``cell``, metres, merged, and the faces (F',) that are left.

        Faces that lose their area or repeat another are dropped; colours are not kept.
        """
        keys = np.floor((self.vertices - self.vertices.min(axis=0)) / cell).astype(np.int64)
        member = np.unique(
            np.ravel_multi_index(tuple(keys.T), tuple(keys.max(axis=0) + 1)), return_inverse=True
        )[1]
        count = np.bincount(member)
        vertices = np.stack([np.bincount(member, self.vertices[:, k]) / count for k in range(3)], axis=1)
        faces = member[self.faces]
        a, b, c = faces.T
        _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
        kept = np.sort(first[((a != b) & (b != c) & (c != a))[first]])
        return TriangleMesh(vertices, faces[kept]), kept

    def with_vertices(self, vertices: ArrayLike) -> TriangleMesh:
        """The same topology and colours at other vertices (V, 3), metres."""
        moved = np.asarray(vertices, dtype=np.float64)
        if moved.shape != self.vertices.shape:
            raise GeometryError(
                f"A mesh of {len(self.vertices)} vertices cannot take vertices of shape {moved.shape}."
            )
        return replace(self, vertices=moved)


@dataclass(frozen=True)
class TexturedMesh:
    """A triangle mesh with textures and colours.

    ``mesh``: its vertices and faces, Z-up; ``uv`` (F, 3, 2) float32, texture coordinates of each face's corners,
    v upwards, repeating outside [0, 1]; ``texture`` (F,) int, the face's image, -1 for none; ``rgb`` (F, 3, 3)
    float32 in [0, 1], corner colours, which multiply the texture; ``images`` each (H, W, 3) uint8 RGB.
    """

    mesh: TriangleMesh
    uv: NDArray[np.float32]
    texture: NDArray[np.int64]
    rgb: NDArray[np.float32]
    images: tuple[NDArray[np.uint8], ...]

    @property
    def has_colours(self) -> bool:
        """Whether it has any colour of its own; a file without any is read as :data:`GREY`."""
        return bool(self.images) or not (self.rgb == np.float32(GREY)).all()

    @property
    def face_colours(self) -> FloatArray:
        """(F, 3) the colour of each face's middle, in [0, 1]."""
        count = len(self.mesh.faces)
        return self.colours_at(np.arange(count), np.full((count, 3), 1 / 3))

    def painted(self, colour: FloatArray) -> TexturedMesh:
        """The same shape in one colour (3,), without images."""
        rgb = np.broadcast_to(colour, self.rgb.shape).astype(np.float32)
        return replace(self, rgb=rgb, texture=np.full_like(self.texture, -1), images=())

    def flipped(self) -> TexturedMesh:
        """The same mesh with its faces wound the other way."""
        mesh = replace(self.mesh, faces=self.mesh.faces[:, ::-1])
        return replace(self, mesh=mesh, uv=self.uv[:, ::-1], rgb=self.rgb[:, ::-1])

    def normalised(self) -> TexturedMesh:
        """The same mesh with its bounding box centred at the origin and its longest side 1.

        Raises :class:`GeometryError` when it has no extent.
        """
        low, high = self.mesh.bounds
        side = float((high - low).max())
        if not side > 0:
            raise GeometryError("A mesh whose vertices all coincide cannot be scaled to a longest side of 1.")
        return replace(self, mesh=self.mesh.with_vertices((self.mesh.vertices - 0.5 * (low + high)) / side))

    def content_hash(self) -> str:
        """Hexadecimal digest of everything visible, independent of the file name."""
        digest = hashlib.sha256()
        arrays: tuple[NDArray[Any], ...] = (
            self.mesh.vertices,
            self.mesh.faces,
            self.uv,
            self.texture,
            self.rgb,
            *self.images,
        )
        for array in arrays:
            digest.update(f"{array.shape}{array.dtype}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def surface(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points (N, 3) uniform over the surface, metres, with normals (N, 3) and colours (N, 3) in [0, 1].

        Raises :class:`GeometryError` when no face has an area.
        """
        faces, weights = self.mesh.draw(count, rng)
        return self.mesh.points_at(faces, weights), self.mesh.normals[faces], self.colours_at(faces, weights)

    def coloured(self) -> TriangleMesh:
        """The mesh with the mean colour of its corners at each vertex; without colours where it has none at all."""
        if not self.has_colours:
            return self.mesh
        corners = np.arange(3 * len(self.mesh.faces))
        rgb = self.colours_at(corners // 3, np.eye(3)[corners % 3])
        at = self.mesh.faces.ravel()
        count = np.maximum(np.bincount(at, minlength=len(self.mesh.vertices)), 1)
        mean = [np.bincount(at, rgb[:, k], len(count)) / count for k in range(3)]
        return replace(self.mesh, colours=np.clip(np.stack(mean, axis=1), 0, 1))

    def colours_at(self, faces: NDArray[np.int64], weights: FloatArray) -> FloatArray:
        """(N, 3) colours in [0, 1] of the finest texels at barycentric ``weights`` (N, 3) on ``faces`` (N,)."""
        colours = np.einsum("nk,nkc->nc", weights, self.rgb[faces].astype(np.float64))
        spot = np.einsum("nk,nkc->nc", weights, self.uv[faces].astype(np.float64))
        spot = np.where((spot < 0) | (spot > 1), spot % 1.0, spot)
        for number, image in enumerate(self.images):
            mine = self.texture[faces] == number
            colours[mine] *= bilinear(image, spot[mine]) / 255.0
        return np.asarray(np.clip(colours, 0.0, 1.0))


@dataclass(frozen=True)
class Texture:
    """The images on a surface's faces, each as a pyramid of averages.

    ``uv`` (F, 3, 2) texture coordinates of each face's corners, v upwards; ``image`` (F,) which image, -1 for none;
    ``density`` (F,) texels a metre; ``pyramids``: per image, levels (H, W, 3) float32 in [0, 1], each half of the
    one before.

    A pixel that spans many texels shows their mean, as a camera's does; taking one of them would turn fine print into
    noise. Unused parts of an image (often black) do not enter the means.
    """

    uv: NDArray[np.float32]
    image: NDArray[np.int64]
    density: FloatArray
    pyramids: tuple[tuple[NDArray[np.float32], ...], ...]

    @classmethod
    def of(cls, textured: TexturedMesh) -> Texture | None:
        """The texture of a mesh; None if it has none."""
        if not textured.images:
            return None
        uv = np.asarray(textured.uv, dtype=np.float32)
        inside = (
            uv
            - np.where((uv.min(axis=1) < 0) | (uv.max(axis=1) > 1), np.floor(uv.mean(axis=1)), 0.0)[:, None]
        )
        uv = np.clip(inside, 0.0, 1.0).astype(np.float32)
        sizes = np.array([image.shape[1::-1] for image in textured.images], dtype=np.float64)  # (I, 2) w, h
        texels = uv * sizes[np.maximum(textured.texture, 0)][:, None]
        a, b = texels[:, 1] - texels[:, 0], texels[:, 2] - texels[:, 0]
        painted = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        area = textured.mesh.areas
        density = np.sqrt(np.divide(painted, area, out=np.zeros_like(area), where=area > 0))
        pyramids = [_pyramid(image, uv[textured.texture == n]) for n, image in enumerate(textured.images)]
        return cls(uv, np.asarray(textured.texture, dtype=np.int64), density, tuple(pyramids))

    def at(self, faces: NDArray[np.int64], weights: FloatArray, footprint: FloatArray) -> FloatArray:
        """(N, 3) colours in [0, 1] where pixels meet faces (N,) at barycentric ``weights`` (N, 3).

        ``footprint`` (N,) is how many metres of the surface a pixel spans there. White where a face has no image.
        """
        colours = np.ones((len(faces), 3))
        spot = np.einsum("nk,nkc->nc", weights, self.uv[faces])
        with np.errstate(divide="ignore"):
            level = np.rint(np.log2(np.maximum(footprint * self.density[faces], 1.0))).astype(int)
        for number, pyramid in enumerate(self.pyramids):
            mine = self.image[faces] == number
            for depth in np.unique(np.minimum(level[mine], len(pyramid) - 1)):
                chosen = mine & (np.minimum(level, len(pyramid) - 1) == depth)
                colours[chosen] = bilinear(pyramid[depth], spot[chosen])
        return colours


def _pyramid(image: NDArray[np.uint8], uv: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
    """The image, and its averages over blocks of 2, 4, 8, ... texels a side.

    Texels that no face of ``uv`` (F, 3, 2) uses hardly count; odd last rows and columns are left out.
    """
    height, width = image.shape[:2]
    canvas = Image.new("L", (width, height))
    draw = ImageDraw.Draw(canvas)
    for face in ((uv * (1, -1) + (0, 1)) * (width, height)).astype(np.float64):
        draw.polygon([(x, y) for x, y in face.tolist()], fill=1, outline=1)
    weight = np.maximum(np.asarray(canvas, dtype=np.float32), np.float32(UNUSED))[..., None]
    levels = [np.asarray(image, dtype=np.float32) / np.float32(255)]
    total = levels[0] * weight
    while len(levels) < LEVELS and min(total.shape[:2]) >= 2:
        total, weight = (
            x[: x.shape[0] // 2 * 2, : x.shape[1] // 2 * 2]
            .reshape(x.shape[0] // 2, 2, x.shape[1] // 2, 2, -1)
            .sum(axis=(1, 3))
            for x in (total, weight)
        )
        levels.append(total / weight)
    return tuple(levels)


def bilinear(image: NDArray[np.uint8] | NDArray[np.float32], uv: FloatArray) -> FloatArray:
    """(N, 3) of an image (H, W, 3) at uv (N, 2), between texel centres at ((i + .5) / W, 1 - (j + .5) / H)."""
    height, width = image.shape[:2]
    where = np.stack([(1.0 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5])
    channels = np.moveaxis(image, -1, 0)
    sampled = [map_coordinates(c, where, output=np.float64, order=1, mode="nearest") for c in channels]
    return np.stack(sampled, axis=1)
