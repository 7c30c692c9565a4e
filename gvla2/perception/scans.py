"""A folder of known objects: each scan as points with normals and colours, and its resting poses."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.transform import FloatArray
from gvla2.io.array_cache import cache_folder, cached_arrays
from gvla2.perception.nearest import NearestPoints
from gvla2.planning.colours import appearance

SUFFIXES = (".obj", ".glb", ".ply")
POINTS = 3000
"""Samples of a scan's surface."""
LARGEST = 3.0
"""A scan with a longest side above this is in millimetres: nothing on a table is 3 m long."""
MOST_RESTS, LIKELY = 14, 0.99
"""Most resting poses tried, and the share of the total probability that they cover."""
TRUNCATED = 0.02
"""Metres at which a point's distance from a scan is truncated."""
VERSION = 3
_COMMON = ("textured", "model", "mesh", "texture", "visual", "nontextured", "poisson")
"""Stems that do not name an object: its folder does. Of several in a folder the first one here counts."""
_FOR_PHYSICS = ("collision", "convex", "coacd", "decomp")
"""Words in the names of files made for physics engines, which are left out."""


@dataclass(frozen=True)
class KnownScan:
    """One known object.

    ``points`` (M, 3) metres about the middle of its box, ``normals`` (M, 3) outward, ``rgb`` (M, 3) in [0, 1];
    ``rests`` (K, 3, 3) turn it into resting poses on a table, likeliest first; ``middle`` (3,) is the box's middle in
    the file's frame, metres; ``scale`` takes the file's units to metres; ``looks`` (M, 3) of the points; ``corners``
    (H, 3) of the convex hull; ``diameter`` is the longest distance within it, metres.
    """

    name: str
    path: str
    points: FloatArray
    normals: FloatArray
    rgb: FloatArray
    rests: FloatArray
    middle: FloatArray
    scale: float
    looks: FloatArray
    corners: FloatArray
    diameter: float

    @cached_property
    def nearest(self) -> NearestPoints:
        """The nearest of its points."""
        return NearestPoints(self.points, TRUNCATED)


def corners_of(points: FloatArray) -> FloatArray:
    """(H, 3) the corners of the convex hull of points (N, 3); some of the points if they are all in a plane."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return points[:: max(1, len(points) // 500)]


def diameter(corners: FloatArray) -> float:
    """The longest distance between two of some points (H, 3), metres."""
    return float(pdist(corners).max()) if len(corners) > 1 else 0.0


def scan_files(folder: str | os.PathLike[str]) -> dict[str, Path]:
    """Each scan's file by the object's name: a file's stem, or its folder's name where there is one file a folder.

    Raises :class:`ConfigurationError` for a folder that is missing or holds no mesh, and for duplicate names.
    """
    root = Path(folder).expanduser()
    if not root.is_dir():
        raise ConfigurationError(f"{root}: there is no such folder of scans.")
    files = [p for p in root.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file()]
    files = sorted(p for p in files if not any(word in p.stem.lower() for word in _FOR_PHYSICS))
    if not files:
        raise ConfigurationError(
            f"The folder {root} holds no mesh. Put scans there as NAME.glb or NAME/textured.obj "
            f"({', '.join(SUFFIXES)})."
        )
    found: dict[str, Path] = {}
    for file in sorted(files, key=_rank):
        own = file.stem if _rank(file) < 0 else _folder_name(file, root)
        name = " ".join(re.split(r"[\W_]+", own)).strip().lower()
        if not name:
            raise ConfigurationError(f"{file} does not name an object; name the file after it.")
        if name not in found:
            found[name] = file
        elif _rank(found[name]) == _rank(file) or _rank(found[name]) < 0:
            raise ConfigurationError(
                f"{root} holds two scans called '{name}': {found[name]} and {file}. Rename one."
            )
    return dict(sorted(found.items()))


def _rank(file: Path) -> int:
    """The file's place in the order of the stems that do not name an object; -1 for one that does."""
    stem = file.stem.lower()
    return _COMMON.index(stem) if stem in _COMMON else -1


def _folder_name(file: Path, root: Path) -> str:
    """The nearest meaningful folder name (YCB keeps NAME/google_16k/textured.obj)."""
    for folder in file.relative_to(root).parents:
        if folder.name and not re.fullmatch(r"google_\d+k|meshes?|tsdf|poisson", folder.name):
            return folder.name
    return root.name


def read_scans(folder: str | os.PathLike[str]) -> list[KnownScan]:
    """All scans of a folder; prepared scans are cached by the files' contents.

    Raises :class:`ConfigurationError` as :func:`scan_files`, and :class:`GeometryError` for a broken mesh.
    """
    return [read_scan(name, path) for name, path in scan_files(folder).items()]


def read_scan(name: str, path: Path) -> KnownScan:
    """One scan, prepared or from the cache."""
    arrays = cached_arrays(cache_folder() / "scans", _content(path), partial(_prepared, path))
    points, corners = arrays["points"], corners_of(arrays["points"])
    return KnownScan(
        name, str(path), points, arrays["normals"], arrays["rgb"], arrays["rests"], arrays["middle"],
        float(arrays["scale"]), appearance(arrays["rgb"]), corners, diameter(corners),
    )  # fmt: skip


def _prepared(path: Path) -> dict[str, FloatArray]:
    textured = read_textured_mesh(path)
    points, normals, rgb = textured.surface(POINTS, np.random.default_rng(0))
    mesh = textured.mesh
    if mesh.volume < 0 and trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight:
        normals = -normals  # faces wound inside out
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max())
    if not longest > 0:
        raise GeometryError(f"{path}: a scan whose points all coincide cannot be recognised.")
    scale = 0.001 if longest > LARGEST else 1.0
    middle = 0.5 * (low + high) * scale
    points = points * scale - middle
    return {
        "points": points, "normals": normals, "rgb": rgb, "middle": middle, "scale": np.array(scale),
        "rests": resting_turns(points),
    }  # fmt: skip


def resting_turns(points: FloatArray) -> FloatArray:
    """(K, 3, 3) rotations into stable resting poses, likeliest first, no two nearly the same; upright is always among
    them.

    Their quasi-static probabilities of the faces of the convex hull, with the middle of the box as the centre of mass.
    Scans are not closed, so their volume gives no better one.
    """
    hull = trimesh.convex.convex_hull(points)
    turns, chances = trimesh.poses.compute_stable_poses(hull, center_mass=hull.center_mass, n_samples=1)
    kept: list[FloatArray] = [np.eye(3)]
    downs = [np.array([0.0, 0.0, 1.0])]
    gone = 0.0
    for turn, chance in zip(turns[:, :3, :3], chances, strict=True):
        gone += float(chance)
        up = turn[2]
        if all(up @ other < np.cos(np.deg2rad(12.0)) for other in downs):
            kept.append(turn)
            downs.append(up)
        if len(kept) >= MOST_RESTS + 1 or gone > LIKELY * float(chances.sum()):
            break
    return np.array(kept)


def _content(path: Path) -> str:
    """The digest of a file's contents; textures beside a mesh count as its contents."""
    digest = hashlib.sha256(f"{VERSION} {POINTS} {path.suffix}".encode())
    beside = sorted(p for p in path.parent.iterdir() if p.suffix.lower() in (".mtl", ".png", ".jpg", ".jpeg"))
    for file in (path, *(beside if path.suffix.lower() == ".obj" else ())):
        try:
            digest.update(file.read_bytes())
        except OSError as error:
            raise GeometryError(f"Cannot read {file}: {error}") from error
    return digest.hexdigest()


def check_names(scans: Sequence[KnownScan]) -> None:
    """Raise :class:`ConfigurationError` for two scans of one name."""
    names = [scan.name for scan in scans]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigurationError(f"Two scans of the gallery are called '{twice[0]}'. Rename one.")
