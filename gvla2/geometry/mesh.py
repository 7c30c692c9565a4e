"""Triangle meshes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray


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
        areas = self.areas
        total = areas.sum()
        if not total > 0:
            raise GeometryError(
                f"No face of the mesh has an area ({len(self.faces)} faces): nothing to sample."
            )
        chosen = rng.choice(len(areas), size=count, p=areas / total)
        # The square root makes the triangle's far side as dense as its tip (Osada et al. 2002, eq. 1).
        u, v = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
        a, b, c = (self.vertices[self.faces[chosen, k]] for k in range(3))
        return (1 - u) * a + u * (1 - v) * b + u * v * c, chosen

    def with_vertices(self, vertices: ArrayLike) -> TriangleMesh:
        """The same topology and colours at other vertices (V, 3), metres."""
        moved = np.asarray(vertices, dtype=np.float64)
        if moved.shape != self.vertices.shape:
            raise GeometryError(
                f"A mesh of {len(self.vertices)} vertices cannot take vertices of shape {moved.shape}."
            )
        return replace(self, vertices=moved)
