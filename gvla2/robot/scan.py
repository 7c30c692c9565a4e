"""Meshes as solid objects: a file read, cleaned up and measured; a body made of it; a folder of them by name."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from gvla2.errors import ConfigurationError, GeometryError, did_you_mean
from gvla2.geometry.mesh import Texture, TexturedMesh, TriangleMesh
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.transform import FloatArray, transform_points

if TYPE_CHECKING:
    from gvla2.robot.task import Body

MOST_FACES = 100_000
"""Most faces of a solid; a finer mesh is simplified, its texture becomes one colour per face."""

HUGE, MILLIMETRE = 3.0, 1e-3
"""A mesh with a longest side above this many metres is read as millimetres, unless its scale is given."""

SMALLEST, LARGEST = 0.003, 2.0
"""Longest side of an object on a table, metres."""


@dataclass(frozen=True, eq=False)
class Scan:
    """One solid of a body that is a mesh, as :class:`gvla2.robot.task.Primitive` is one that is a simple shape.

    ``textured`` in metres, its bounding box centred at the origin of the solid's own frame; ``body_from_shape`` (4, 4).
    ``offset`` (3,) is where that centre lay in the frame of the file ``path``, metres, with ``scale`` metres per unit.
    ``notes`` are sentences on what was cleaned up.
    """

    textured: TexturedMesh
    offset: FloatArray
    path: str
    scale: float
    notes: tuple[str, ...] = ()
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
        return face_colours(self.textured, self.texture)

    @cached_property
    def hull(self) -> FloatArray:
        """(N, 3) the corners of its convex hull, the solid's frame."""
        vertices = self.textured.mesh.vertices
        try:
            return np.asarray(vertices[ConvexHull(vertices).vertices])
        except QhullError:  # flat, without a volume
            return vertices

    def lowest(self, world_from_body: FloatArray) -> float:
        """World z of its lowest point with the body at ``world_from_body`` (4, 4), metres."""
        return float(transform_points(world_from_body @ self.body_from_shape, self.hull)[:, 2].min())


@lru_cache(maxsize=64)
def _read(path: Path, scale: float | None, stamp: tuple[int, int]) -> Scan:
    del stamp  # a changed file counts as another file
    return _ordered(read_textured_mesh(path), scale, path)


def read_scan(path: str | os.PathLike[str], scale: float | None = None) -> Scan:
    """The mesh of an OBJ, GLB or PLY file, ``scale`` metres per unit of the file (None: guessed), after these steps in
    order:

    * millimetres: a mesh longer than :data:`HUGE` is taken to be in millimetres when ``scale`` is None;
    * inside out: with a negative volume, its faces are flipped;
    * too fine: beyond :data:`MOST_FACES` it is simplified by vertex clustering, each face keeping its colour;
    * no texture: vertex colours, the material's colour, or grey.

    ``notes`` say which were applied. Raises :class:`ConfigurationError` for a scale that is not positive or an object
    of impossible size, and :class:`GeometryError`, naming the file, for one that cannot be read.
    """
    source = Path(path).expanduser()
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise ConfigurationError(f"{source}: scale={scale} must be a positive number of metres per unit.")
    if not source.is_file():
        raise GeometryError(f"Cannot read a mesh from {source}: there is no such file.")
    state = source.stat()
    return _read(source.resolve(), scale, (state.st_mtime_ns, state.st_size))


def _ordered(textured: TexturedMesh, scale: float | None, source: Path) -> Scan:
    notes = []
    mesh = textured.mesh
    low, high = mesh.bounds
    longest = float((high - low).max())
    factor = scale
    if factor is None:
        factor = MILLIMETRE if longest > HUGE else 1.0
        if factor != 1.0:
            notes.append(f"it is {longest:.0f} units long and was read as millimetres")
    if not SMALLEST <= longest * factor <= LARGEST:
        raise ConfigurationError(
            f"{source} is {longest * factor:.4g} m long; an object on the table has {SMALLEST} to {LARGEST} m. "
            "Give the metres per unit of the file with scale (0.001 for millimetres, 0.01 for centimetres)."
        )
    offset = 0.5 * (low + high) * factor
    textured = replace(textured, mesh=mesh.with_vertices(mesh.vertices * factor - offset))
    if textured.mesh.volume < 0:
        textured = _turned(textured)
        notes.append("its volume was negative and its faces were flipped")
    count = len(textured.mesh.faces)
    if count > MOST_FACES:
        textured = _thinned(textured, MOST_FACES)
        notes.append(f"it was simplified from {count} to {len(textured.mesh.faces)} faces")
    if not textured.images and np.ptp(textured.rgb.reshape(-1, 3), axis=0).max() == 0:
        notes.append("it has no texture")
    return Scan(textured, offset, str(source), factor, tuple(notes))


def face_colours(textured: TexturedMesh, texture: Texture | None) -> FloatArray:
    """(F, 3) colour of each face's middle, in [0, 1]."""
    colours = np.asarray(textured.rgb.mean(axis=1), dtype=np.float64)
    if texture is None:
        return colours
    count = len(textured.mesh.faces)
    wide = np.sqrt(textured.mesh.areas)
    return np.asarray(colours * texture.at(np.arange(count), np.full((count, 3), 1 / 3), wide))


def _turned(textured: TexturedMesh) -> TexturedMesh:
    mesh = textured.mesh
    return replace(
        textured,
        mesh=TriangleMesh(mesh.vertices, mesh.faces[:, ::-1], mesh.colours),
        uv=textured.uv[:, ::-1],
        rgb=textured.rgb[:, ::-1],
    )


def _thinned(textured: TexturedMesh, most: int) -> TexturedMesh:
    """Vertices of one cell are merged, cells as fine as ``most`` faces allow; each face keeps its own colour."""
    colours = face_colours(textured, Texture.of(textured)).astype(np.float32)
    mesh = textured.mesh
    cell = np.sqrt(2.0 * mesh.areas.sum() / most)
    while True:
        coarse, kept = mesh.clustered(cell)
        if len(kept) <= most:
            break
        cell *= 1.15
    return TexturedMesh(
        coarse,
        np.zeros((len(kept), 3, 2), dtype=np.float32),
        np.full(len(kept), -1, dtype=np.int64),
        np.repeat(colours[kept][:, None], 3, axis=1),
        (),
    )


@dataclass(frozen=True)
class Mesh:
    """A file and its object's physics: ``scale`` metres per unit of the file (None: metres, or millimetres if only that
    makes sense), ``mass`` in kilograms, ``friction`` against other objects.

    >>> mug = Mesh("scans/mug.glb", mass=0.12).body("mug", world_from_body)
    >>> Layout((mug, *others))
    """

    path: str | os.PathLike[str]
    scale: float | None = None
    mass: float = 0.1
    friction: float = 0.8

    def body(
        self, name: str, world_from_body: FloatArray, *, label: str = "", fixed: bool = False, shape: str = ""
    ) -> Body:
        """The body whose frame is the middle of the mesh's bounding box, at ``world_from_body`` (4, 4).

        Raises as :func:`gvla2.robot.scan.read_scan` does, and :class:`ConfigurationError` for an impossible mass or
        friction.
        """
        from gvla2.robot.task import Body

        if not (self.mass > 0 and self.friction >= 0):
            raise ConfigurationError(
                f"{self.path}: an object has a mass above 0 and a friction of at least 0, got mass={self.mass}, "
                f"friction={self.friction}."
            )
        scan = read_scan(self.path, self.scale)
        return Body(
            name,
            (scan,),
            world_from_body,
            self.mass,
            fixed,
            self.friction,
            label or name,
            shape or scan_shape(scan.size),
        )


def scan_shape(size: tuple[float, float, float]) -> str:
    """A mesh's :data:`gvla2.planning.scene.Shape` by its sides alone: long objects are bars, the rest is "other"."""
    short, middle, long = sorted(size)
    return "bar" if long > 3.0 * middle and short > 0 else "other"


SUFFIXES = (".obj", ".glb", ".ply")

FAVOURITES = ("textured", "model", "mesh", "nontextured")
"""Stems that scanned data sets use for an object's own mesh, the best first."""

NOT_SHOWN = ("collision", "convex", "coacd", "decomp")
"""Words in the names of files made for physics engines."""


def mesh_library(root: str | os.PathLike[str]) -> dict[str, Path]:
    """The mesh of each object in a folder, by name: a file's own stem, or the name of a folder with a mesh in it.

    ``mug.glb`` and ``mug/textured.obj`` are both the object "mug"; deeper folders (``mug/google_16k/textured.obj``) are
    searched too. Raises :class:`ConfigurationError` for a folder that is missing or holds no mesh, two meshes of one
    name, and an object's folder with several meshes, none of them called :data:`FAVOURITES`.
    """
    if not str(root):
        raise ConfigurationError("task=tabletop_objects needs a folder of meshes: task.objects.root=FOLDER.")
    folder = Path(root).expanduser()
    if not folder.is_dir():
        raise ConfigurationError(f"There is no folder {folder} to take objects from.")
    found: dict[str, Path] = {}
    for entry in sorted(folder.iterdir()):
        path = _mesh_in(entry) if entry.is_dir() else entry if entry.suffix.lower() in SUFFIXES else None
        if path is None or entry.name.startswith("."):
            continue
        name = entry.name if entry.is_dir() else entry.stem
        if name in found:
            raise ConfigurationError(
                f"Two meshes in {folder} are called '{name}': {_inside(found[name], folder)} and "
                f"{_inside(path, folder)}. Rename one."
            )
        found[name] = path
    if not found:
        raise ConfigurationError(
            f"The folder {folder} holds no meshes. It needs {', '.join(SUFFIXES)} files, or folders with one each."
        )
    return found


def chosen(library: Mapping[str, Path], names: Sequence[str]) -> dict[str, Path]:
    """The objects of these names, all of them without any; spaces may replace underscores.

    Raises :class:`ConfigurationError` for a name that is unknown or given twice.
    """
    if not names:
        return dict(library)
    plain = {spoken(name): name for name in library}
    picked: dict[str, Path] = {}
    for name in names:
        known = name if name in library else plain.get(spoken(name))
        if known is None:
            hint = did_you_mean(name, library)
            raise ConfigurationError(f"There is no object '{name}'.{hint} Available: {', '.join(library)}.")
        if known in picked:
            raise ConfigurationError(
                f"The object '{known}' is named twice; an instruction could not distinguish them."
            )
        picked[known] = library[known]
    return picked


def spoken(name: str) -> str:
    """The everyday name of the object of that name: "cracker box" for ``003_cracker_box``."""
    words = name.replace("_", " ").replace("-", " ").lower().split()
    return " ".join(words[1:] if len(words) > 1 and words[0].isdigit() else words)


def _mesh_in(folder: Path) -> Path | None:
    """The mesh of an object's own folder; None where there is none."""
    meshes = sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in SUFFIXES and not any(word in path.stem.lower() for word in NOT_SHOWN)
    )
    for stem in FAVOURITES:
        named = [path for path in meshes if path.stem.lower() == stem]
        if named:
            return named[0]
    if len(meshes) > 1:
        raise ConfigurationError(
            f"The folder {folder} holds {len(meshes)} meshes ({', '.join(p.name for p in meshes[:4])}, ...): name one "
            f"of them {FAVOURITES[0]}{meshes[0].suffix}, or leave only one."
        )
    return meshes[0] if meshes else None


def _inside(path: Path, folder: Path) -> str:
    return str(path.relative_to(folder))
