"""A folder of known objects: each scan as points with normals and colours, and its resting poses."""

from __future__ import annotations

import hashlib
import logging
import os
import re
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, GeometryError, reading
from gvla2.geometry.articulated_files import read_articulated
from gvla2.geometry.mesh_files import READABLE, read_textured_mesh
from gvla2.geometry.transform import FloatArray
from gvla2.io.array_cache import cache_folder, cached_arrays
from gvla2.io.files import visible_files
from gvla2.perception.articulated import joint_of
from gvla2.perception.nearest import NearestPoints
from gvla2.planning.colours import appearance
from gvla2.planning.scene import PartJoint

POINTS, MOST_SAMPLES, SPACING = 3000, 12_000, 0.006
"""Minimum and maximum number of samples of a scan's surface; between them, one for each square of this side, metres."""
LARGEST = 3.0
"""A scan with a longest side above this is in millimetres: nothing on a table is 3 m long."""
MOST_RESTS, LIKELY = 14, 0.99
"""Maximum number of resting poses tried, and the share of the total probability that they cover."""
FLAT = 1e-6
"""Thickness over length of a scan below which it has no hull."""
TRUNCATED = 0.02
"""Metres at which a point's distance from a scan is truncated."""
TURNS = Rotation.from_rotvec(np.outer(np.arange(20) * (2 * np.pi / 20), [0.0, 0.0, 1.0])).as_matrix()
"""(20, 3, 3) turns about the vertical that are tried for each resting pose."""
VERSION = 9
_COMMON = ("textured", "model", "mesh", "texture", "visual", "nontextured", "poisson")
"""Stems that do not name an object: its folder does. Of several in a folder the first one here counts."""
_MODELS = ("mobility", "robot", "urdf")
"""Stems of URDFs that do not name an object either."""
_FOR_PHYSICS = ("collision", "convex", "coacd", "decomp")
"""Words in the names of files made for physics engines, which are left out."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class KnownLink:
    """A moving part of a scan: its ``name``, and its joint in the scan's frame."""

    name: str
    joint: PartJoint


@dataclass(frozen=True)
class KnownScan:
    """One known object.

    ``points`` (M, 3) metres about the middle of its box, ``normals`` (M, 3) outward, ``rgb`` (M, 3) in [0, 1];
    ``rests`` (K, 3, 3) turn it into resting poses on a table, likeliest first; ``middle`` (3,) is the box's middle in
    the file's frame, metres; ``scale`` takes the file's units to metres; ``looks`` (M, 3) of the points; ``corners``
    (H, 3) of the convex hull; ``diameter`` is the longest distance within it, metres. ``links`` move on joints, in the
    same frame as the points; ``owners`` (M,) are the points' indices of these, -1 for what does not move. ``outer``
    (M,) are the points that can be seen from outside when all is closed.
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
    links: tuple[KnownLink, ...] = ()
    owners: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    outer: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))

    @cached_property
    def skin(self) -> KnownScan:
        """The scan without what lies inside."""
        if self.outer.all():
            return self
        of = self.outer
        return replace(
            self, points=self.points[of], normals=self.normals[of], rgb=self.rgb[of], looks=self.looks[of],
            owners=self.owners[of], outer=of[of],
        )  # fmt: skip

    @cached_property
    def nearest(self) -> NearestPoints:
        """The nearest of its points."""
        return NearestPoints(self.points, TRUNCATED)

    @cached_property
    def lying(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The resting poses at each of :data:`TURNS` (K, 20, 3, 3), and the least and the greatest coordinates of the
        scan so turned (K, 20, 3), metres.
        """
        turns = TURNS @ self.rests[:, None]
        lain = turns @ self.corners.T
        return turns, lain.min(axis=-1), lain.max(axis=-1)


def corners_of(points: FloatArray) -> FloatArray:
    """(H, 3) the corners of the convex hull of points (N, 3); some of the points if they are all in a plane."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return points[:: max(1, len(points) // 500)]


def diameter(corners: FloatArray) -> float:
    """The longest distance between two of some points (H, 3), metres."""
    return float(pdist(corners).max()) if len(corners) > 1 else 0.0


def scan_files(folder: str | os.PathLike[str], *, joints: bool = False) -> dict[str, Path]:
    """Each scan's file by the object's name: a file's stem, or its folder's name where there is one file a folder.

    With ``joints``, a URDF is an object too; the meshes that it refers to are never objects of their own.

    Raises :class:`ConfigurationError` for a folder that is missing or holds no mesh, and for duplicate names.
    """
    root = Path(folder).expanduser()
    if not root.is_dir():
        raise ConfigurationError(f"{root}: there is no such folder of scans.")
    every = visible_files(root)
    models = [p for p in every if p.suffix.lower() == ".urdf"]
    within = {mesh for model in models for mesh in _meshes_of(model)}
    meshes = [p for p in every if p.suffix.lower() in READABLE]
    order = {suffix: place for place, suffix in enumerate(READABLE)}
    meshes.sort(key=lambda p: order[p.suffix.lower()], reverse=True)
    files = list({p.with_suffix(""): p for p in meshes}.values())  # one of a scan in several formats
    files = [p for p in files if not any(word in p.stem.lower() for word in _FOR_PHYSICS)]
    files = sorted([*(models if joints else ()), *(p for p in files if p.absolute() not in within)])
    if not files:
        raise ConfigurationError(
            f"The folder {root} holds no mesh. Put scans there as NAME.glb or NAME/textured.obj "
            f"({', '.join(READABLE)}){', what has joints as NAME.urdf with its meshes' if joints else ''}."
        )
    found: dict[str, Path] = {}
    for file in sorted(files, key=_rank):
        named = file.stem if _rank(file) < 0 and file.stem.lower() not in _MODELS else ""
        own = named or _folder_name(file, root)
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


def _meshes_of(model: Path) -> Collection[Path]:
    """The meshes that a URDF refers to; none for a broken one, whose fault :func:`read_scans` reports."""
    try:
        return read_articulated(model).files
    except GeometryError:
        return ()


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


def entry_file(folder: str | os.PathLike[str], name: str, *, replace: bool = False) -> Path:
    """The file, NAME.glb, by which an object called ``name`` is added to a folder that may not exist yet.

    Raises :class:`ConfigurationError` for a name that the folder would not give back, and, unless it is to be
    replaced, for one that it has.
    """
    root, words = Path(folder).expanduser(), re.findall(r"[^\W_]+", name.lower())
    stem = "_".join(words)
    if not words or stem in (*_COMMON, *_MODELS) or any(word in stem for word in _FOR_PHYSICS):
        raise ConfigurationError(f"'{name}' cannot name an object of a gallery: choose another name.")
    target = root / f"{stem}.glb"
    known = scan_files(root, joints=True) if root.is_dir() and any(root.iterdir()) else {}
    present = known.get(" ".join(words))
    if present is not None and not (replace and present == target):
        how = "replace=true writes over it" if present == target else "remove it first"
        raise ConfigurationError(
            f"'{name}' is in the gallery already: {present}. Choose another name; {how}."
        )
    return target


def read_scans(folder: str | os.PathLike[str]) -> list[KnownScan]:
    """All scans of a folder; prepared scans are cached by the files' contents.

    One that cannot be read is left out with a warning. Raises :class:`ConfigurationError` as :func:`scan_files`, and
    for a folder whose scans are all broken.
    """
    scans, broken = [], []
    for name, path in scan_files(folder, joints=True).items():
        try:
            scans.append(read_scan(name, path))
        except GeometryError as error:
            broken.append(str(error))
            log.warning("'%s' is left out of the known objects: %s", name, error)
    if not scans:
        raise ConfigurationError(f"No scan below {folder} can be read. {broken[0]}")
    return scans


def read_scan(name: str, path: Path) -> KnownScan:
    """One scan, prepared or from the cache; raises :class:`GeometryError` for one that cannot be read."""
    with reading("a scan", path):
        arrays = cached_arrays(cache_folder() / "scans", _content(path), partial(_prepared, path))
    points, corners = arrays["points"], corners_of(arrays["points"])
    links: tuple[KnownLink, ...] = ()
    if path.suffix.lower() == ".urdf":
        links = tuple(
            KnownLink(
                " ".join(re.split(r"[\W_]+", link.name)).strip().lower(),
                joint_of(link.slides, link.axis, link.origin - arrays["middle"], 0.0, link.low, link.high),
            )
            for link in read_articulated(path).links
        )
    return KnownScan(
        name, str(path), points, arrays["normals"], arrays["rgb"], arrays["rests"], arrays["middle"],
        float(arrays["scale"]), appearance(arrays["rgb"]), corners, diameter(corners), links, arrays["owners"],
        arrays["outer"],
    )  # fmt: skip


def _prepared(path: Path) -> dict[str, FloatArray]:
    articulated = path.suffix.lower() == ".urdf"
    meshes = read_articulated(path).meshes() if articulated else [(-1, read_textured_mesh(path))]
    vertices = np.concatenate([textured.mesh.vertices for _, textured in meshes])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    longest = float((high - low).max())
    if not longest > 0:
        raise GeometryError(f"{path}: a scan whose points all coincide cannot be recognised.")
    scale = 0.001 if longest > LARGEST and not articulated else 1.0
    areas = np.array([textured.mesh.areas.sum() for _, textured in meshes])
    count = int(np.clip(areas.sum() * (scale / SPACING) ** 2, POINTS, MOST_SAMPLES))
    sampled = []
    rng = np.random.default_rng(0)
    for (owner, textured), share in zip(meshes, areas / areas.sum(), strict=True):
        points, normals, rgb = textured.surface(max(1, round(share * count)), rng)
        mesh = textured.mesh
        if mesh.volume < 0 and trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight:
            normals = -normals  # faces wound inside out
        sampled.append((points, normals, rgb, np.full(len(points), owner)))
    points, normals, rgb, owners = (np.concatenate(each) for each in zip(*sampled, strict=True))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) * scale
    points = points * scale - middle
    return {
        "points": points, "normals": normals, "rgb": rgb, "middle": middle, "scale": np.array(scale),
        "rests": np.eye(3)[None] if articulated else resting_turns(points), "owners": owners,
        "outer": outer_points(points, normals) if articulated else np.ones(len(points), dtype=bool),
    }  # fmt: skip


def outer_points(points: FloatArray, normals: FloatArray) -> NDArray[np.bool_]:
    """(M,) which samples of a surface can be seen from outside, from any of 26 directions around."""
    spacing = float(np.sqrt(np.ptp(points, axis=0).max() ** 2 * 6.0 / len(points)))
    outer = np.zeros(len(points), dtype=bool)
    for way in np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3):
        if not way.any():
            continue
        way = way / np.linalg.norm(way)
        across = np.linalg.svd(way[None])[2][1:]
        depth, cells = points @ way, np.floor(points @ across.T / spacing).astype(int)
        index = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
        front = np.full(index.max() + 1, -np.inf)
        np.maximum.at(front, index, depth)
        outer |= (depth > front[index] - spacing) & (normals @ way > 0.25)
    return outer


def resting_turns(points: FloatArray) -> FloatArray:
    """(K, 3, 3) rotations into stable resting poses, likeliest first, no two nearly the same; upright is always among
    them.

    Their quasi-static probabilities of the faces of the convex hull, with the middle of the box as the centre of mass.
    Scans are not closed, so their volume gives no better one. A sheet without thickness lies as its file has it.
    """
    across = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if across[2] < FLAT * across[0]:
        return np.eye(3)[None]
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
    digest = hashlib.sha256(f"{VERSION} {path.suffix}".encode())
    meshes = sorted(read_articulated(path).files) if path.suffix.lower() == ".urdf" else [path]
    folders = {mesh.parent for mesh in meshes if mesh.suffix.lower() == ".obj"}
    looks = (".mtl", ".png", ".jpg", ".jpeg")
    beside = sorted(p for folder in folders for p in folder.iterdir() if p.suffix.lower() in looks)
    for file in dict.fromkeys((path, *meshes, *beside)):
        with reading("a scan", file):
            digest.update(file.read_bytes())
    return digest.hexdigest()
