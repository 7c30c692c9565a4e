"""Meshes as solid objects: a file read, cleaned up and measured; a body made of it; a folder of them by name."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from gvla2.errors import ConfigurationError, GeometryError, did_you_mean
from gvla2.geometry.mesh import Texture, TexturedMesh
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.transform import FloatArray
from gvla2.perception.scans import corners_of, scan_files

if TYPE_CHECKING:
    from gvla2.robot.task import Body

HUGE, MILLIMETRE = 3.0, 1e-3
"""A mesh with a longest side above this many metres is read as millimetres, unless its scale is given."""

SMALLEST, LARGEST = 0.003, 2.0
"""Longest side of an object on a table, metres."""


@dataclass(frozen=True, eq=False)
class Scan:
    """One solid of a body that is a mesh, as :class:`gvla2.robot.task.Primitive` is one that is a simple shape.

    ``textured`` in metres, its bounding box centred at the origin of the solid's own frame; ``body_from_shape`` (4, 4).
    ``offset`` (3,) is where that centre lay in the frame of the file ``path``, metres, with ``scale`` metres per unit.
    """

    textured: TexturedMesh
    offset: FloatArray
    path: str
    scale: float
    body_from_shape: FloatArray = field(default_factory=lambda: np.eye(4))
    collides: bool = True
    kind: Literal["mesh"] = "mesh"

    @cached_property
    def size(self) -> tuple[float, float, float]:
        """Sides (x, y, z) of the bounding box, metres."""
        low, high = self.textured.mesh.bounds
        x, y, z = (high - low).tolist()
        return x, y, z

    @cached_property
    def rgb(self) -> tuple[float, float, float]:
        """Mean colour over the surface, in [0, 1]."""
        areas = self.textured.mesh.areas
        r, g, b = np.average(self.face_colours, axis=0, weights=areas).tolist()
        return r, g, b

    @cached_property
    def texture(self) -> Texture | None:
        """Its texture, made once."""
        return Texture.of(self.textured)

    @cached_property
    def face_colours(self) -> FloatArray:
        """(F, 3) colour of each face's middle, in [0, 1], with its texture."""
        colours = np.asarray(self.textured.rgb.mean(axis=1), dtype=np.float64)
        if self.texture is None:
            return colours
        areas = self.textured.mesh.areas
        middles = np.full((len(areas), 3), 1 / 3)
        return np.asarray(colours * self.texture.at(np.arange(len(areas)), middles, np.sqrt(areas)))

    @cached_property
    def hull(self) -> FloatArray:
        """(N, 3) the corners of its convex hull, the solid's frame."""
        return corners_of(self.textured.mesh.vertices)


def read_scan(path: str | os.PathLike[str], scale: float | None = None) -> Scan:
    """The mesh of an OBJ, GLB or PLY file, ``scale`` metres per unit of the file (None: guessed), after these steps in
    order:

    * millimetres: a mesh longer than :data:`HUGE` is taken to be in millimetres when ``scale`` is None;
    * inside out: with a negative volume, its faces are flipped;
    * no texture: vertex colours, the material's colour, or grey.

    Raises :class:`ConfigurationError` for a scale that is not positive or an object of impossible size, and
    :class:`GeometryError`, naming the file, for one that cannot be read.
    """
    source = Path(path).expanduser()
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise ConfigurationError(f"{source}: scale={scale} must be a positive number of metres per unit.")
    if not source.is_file():
        raise GeometryError(f"Cannot read a mesh from {source}: there is no such file.")
    return _read(source.resolve(), scale, source.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _read(source: Path, scale: float | None, changed: int) -> Scan:
    """The file as it was when it was last ``changed``."""
    textured = read_textured_mesh(source)
    low, high = textured.mesh.bounds
    longest = float((high - low).max())
    factor = scale or (MILLIMETRE if longest > HUGE else 1.0)
    if not SMALLEST <= longest * factor <= LARGEST:
        raise ConfigurationError(
            f"{source} is {longest * factor:.4g} m long; an object on the table has {SMALLEST} to {LARGEST} m. "
            "Give the metres per unit of the file with scale (0.001 for millimetres, 0.01 for centimetres)."
        )
    offset = 0.5 * (low + high) * factor
    mesh = textured.mesh.with_vertices(textured.mesh.vertices * factor - offset)
    textured = replace(textured, mesh=mesh)
    return Scan(textured.flipped() if mesh.volume < 0 else textured, offset, str(source), factor)


def scanned_body(
    path: str | os.PathLike[str],
    name: str,
    world_from_body: FloatArray,
    *,
    scale: float | None = None,
    mass: float = 0.1,
    friction: float = 0.8,
    label: str = "",
) -> Body:
    """The body of a mesh file, whose frame is the middle of the mesh's bounding box, at ``world_from_body`` (4, 4).

    ``scale`` is metres per unit of the file (None: metres, or millimetres if only that makes sense), ``mass`` in
    kilograms, ``friction`` against other objects. Raises as :func:`read_scan` does, and :class:`ConfigurationError` for
    an impossible mass or friction.

    >>> mug = scanned_body("scans/mug.glb", "mug", world_from_body, mass=0.12)
    >>> Layout((mug, *others))
    """
    from gvla2.robot.task import Body

    if not (mass > 0 and friction >= 0):
        raise ConfigurationError(
            f"{path}: an object has a mass above 0 and a friction of at least 0, got mass={mass}, friction={friction}."
        )
    scan = read_scan(path, scale)
    short, middle, long = sorted(scan.size)
    shape = "bar" if long > 3.0 * middle and short > 0 else "other"
    return Body(name, (scan,), world_from_body, mass, False, friction, label or name, shape)


def mesh_library(root: str | os.PathLike[str], names: Sequence[str] = ()) -> dict[str, Path]:
    """The mesh of each object in a folder by its name, with underscores (:func:`gvla2.perception.scans.scan_files`).

    ``names`` chooses among them; spaces may replace underscores. Raises :class:`ConfigurationError` for one that is
    unknown or given twice.
    """
    library = {name.replace(" ", "_"): path for name, path in scan_files(root).items()}
    picked: dict[str, Path] = {}
    for name in (one.replace(" ", "_") for one in names):
        if name not in library:
            hint = did_you_mean(name, library)
            raise ConfigurationError(f"There is no object '{name}'.{hint} Available: {', '.join(library)}.")
        if name in picked:
            raise ConfigurationError(
                f"The object '{name}' is named twice; an instruction could not distinguish them."
            )
        picked[name] = library[name]
    return picked or library


def spoken(name: str) -> str:
    """The everyday name of the object of that name: "cracker box" for ``003_cracker_box``."""
    words = name.replace("_", " ").replace("-", " ").lower().split()
    return " ".join(words[1:] if len(words) > 1 and words[0].isdigit() else words)
