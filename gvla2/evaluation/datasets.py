"""The data sets of the reconstruction benchmark: finding them, listing their objects, loading one object.

``ycb30`` and ``meshes`` are folders of textured meshes, rendered here by the protocol. ``gso30`` is a tree of
``<object>/render_mvs_25/model/%03d.{png,npy}`` with true shapes in ``<object>/meshes/model.obj``. Nothing is downloaded
silently: a missing set is an error that says where it was searched and where it comes from.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gvla2.errors import ConfigurationError, did_you_mean
from gvla2.evaluation.protocol import INPUTS, SAMPLES, SIZE, TARGETS, ObjectViews, object_views
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import READABLE
from gvla2.geometry.views import Views
from gvla2.io.files import hidden

MESH_FILES = ("textured.obj", "textured.glb", "model.obj", "mesh.obj", "mesh.glb")
"""File names tried first in an object's folder; else its only mesh."""
GSO_VIEWS = Path("render_mvs_25") / "model"
GSO_MESH = Path("meshes") / "model.obj"
AGREEMENT = 0.9
"""Least symmetric IoU of the true shape's silhouettes and the masks; half a pixel at the edge costs some per cent."""

log = logging.getLogger(__name__)


SOURCES = {
    "ycb30": "the 'google_16k' meshes of the YCB object and model set (CC BY 4.0) as ycb30/<object>/textured.obj, with "
    "their .mtl and texture_map.png",
    "gso30": "the GSO-30 renderings of the benchmark's authors, or your own of Google Scanned Objects (CC BY 4.0), as "
    "gso30/<object>/render_mvs_25/model/000.png, 000.npy, ... and gso30/<object>/meshes/model.obj",
    "meshes": "your own meshes as <object>/textured.obj (or .glb, or any one .obj), with data.root=FOLDER",
}
"""What each kind of data set consists of, and how it is laid out."""


@dataclass(frozen=True)
class Item:
    """One object of a data set: its name, its folder, and the file or folder that its views come from."""

    name: str
    folder: Path
    source: Path

    def fingerprint(self) -> str:
        """Hexadecimal digest of the names, sizes and times of the object's files: changes when they do."""
        digest = hashlib.sha256(self.name.encode())
        for path in sorted(p for p in self.folder.rglob("*") if p.is_file()):
            found = path.stat()
            digest.update(f"{path.relative_to(self.folder)}|{found.st_size}|{found.st_mtime_ns}\n".encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class Dataset:
    """An available data set: ``kind`` is ``ycb30``, ``gso30`` or ``meshes``."""

    kind: str
    root: Path
    items: tuple[Item, ...]
    size: int = SIZE
    samples: int = field(default=SAMPLES, repr=False)

    def load(self, item: Item) -> ObjectViews:
        """The object's views and its true shape; rendered views come from the cache if possible.

        Raises :class:`gvla2.errors.GeometryError` for a file that cannot be used.
        """
        if self.kind != "gso30":
            return object_views(item.source, item.name, size=self.size, samples=self.samples)
        from gvla2.geometry.view_folders import read_views

        inputs, targets = (
            read_views(item.folder, f"{numbers[0]}-{numbers[-1]}", self.size) for numbers in (INPUTS, TARGETS)
        )
        return ObjectViews(item.name, inputs, targets, true_mesh(item.folder / GSO_MESH, inputs))


def open_dataset(
    kind: str,
    root: str | os.PathLike[str] | None = None,
    objects: Sequence[str] = (),
    *,
    size: int = SIZE,
    samples: int = SAMPLES,
) -> Dataset:
    """Find a data set and choose objects of it (all by default, in alphabetical order).

    Without ``root`` the set is searched for where :func:`roots` says. Raises :class:`ConfigurationError` that lists the
    places searched, or the existing objects.
    """
    if kind not in SOURCES:
        raise ConfigurationError(f"No data set '{kind}'. Available: {', '.join(SOURCES)}.")
    looked = [Path(root).expanduser()] if root is not None else roots(kind)
    found = next((place for place in looked if place.is_dir()), None)
    if found is None:
        raise ConfigurationError(
            f"The data set '{kind}' is not here. Looked for: {', '.join(map(str, looked))}. It is {SOURCES[kind]}. "
            "Name its folder with data.root=PATH, or set GVLA2_DATA to the folder that holds it."
        )
    items = {item.name: item for item in find_items(kind, found)}
    if not items:
        raise ConfigurationError(f"{found} holds no object of '{kind}'. Expected there: {SOURCES[kind]}.")
    for name in objects:
        if name not in items:
            hint = did_you_mean(name, items)
            raise ConfigurationError(f"{found} holds no object '{name}'.{hint} It holds: {', '.join(items)}.")
    return Dataset(kind, found, tuple(items[n] for n in dict.fromkeys(objects or items)), size, samples)


def roots(kind: str) -> list[Path]:
    """The folders where a data set is looked for: ``$GVLA2_DATA/<kind>``, then ``../shared/data/<kind>`` beside the
    working folder and the repository.
    """
    own = [Path(os.environ["GVLA2_DATA"]).expanduser()] if os.environ.get("GVLA2_DATA") else []
    beside = [
        folder.parent / "shared" / "data" for folder in (Path.cwd(), Path(__file__).resolve().parents[2])
    ]
    return [place / kind for place in dict.fromkeys([*own, *beside])]


def find_items(kind: str, root: Path) -> tuple[Item, ...]:
    """All objects of a kind under a folder, by name."""
    items = []
    for folder in sorted(path for path in root.iterdir() if path.is_dir() and not hidden(path.name)):
        views = folder / GSO_VIEWS
        source = (views if (views / "000.png").is_file() else None) if kind == "gso30" else _mesh_of(folder)
        if source is not None:
            items.append(Item(folder.name, folder, source))
    return tuple(items)


def _mesh_of(folder: Path) -> Path | None:
    for name in MESH_FILES:
        if (folder / name).is_file():
            return folder / name
    others = [p for p in folder.iterdir() if p.suffix.lower() in READABLE and not hidden(p.name)]
    return others[0] if len(others) == 1 else None


def true_mesh(path: Path, views: Views) -> TriangleMesh | None:
    """The mesh of a file, scaled to a longest side of 1, centred, and turned as in the views.

    The views may have been rendered with the file as Y-up or as Z-up; the masks decide. None, with a warning, when
    there is no file or neither reading agrees with the masks: no Chamfer distance is better than a wrong one.
    """
    from gvla2.evaluation.metrics import unit_box
    from gvla2.geometry.mesh_files import read_mesh, to_z_up
    from gvla2.reconstruction.silhouette import symmetric_iou

    if not path.is_file():
        log.warning("%s is missing: no Chamfer distance for this object.", path)
        return None
    mesh = read_mesh(path)
    upright = mesh.with_vertices(unit_box(mesh.vertices))
    readings = (upright, upright.with_vertices(to_z_up(upright.vertices)))
    score, best = max(
        ((symmetric_iou(one.vertices, views, faces=one.faces), one) for one in readings),
        key=lambda pair: pair[0],
    )
    if not score >= AGREEMENT:
        log.warning("%s does not agree with its views' masks (IoU %.3f): no Chamfer distance.", path, score)
        return None
    return best
