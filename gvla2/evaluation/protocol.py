"""The GSO-30 view protocol on any textured mesh: 25 cameras, five inputs, fifteen held-out targets.

The mesh is scaled to a longest side of 1 and centred. Cameras look at its centre from random points of the sphere, at
radius 1.5 to 2.2 (view 0: radius 1.7 to 2.0 at height 0.9 to 1.1), with a 35 mm lens on a 32 mm sensor. Pictures
have 512 x 512 pixels of 2 x 2 rays and are averaged to 256 x 256 on white. The cameras depend only on the
object's name. Rendered views are cached on disk under a hash of the visible content and the protocol's version.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.textured_mesh import read_textured_mesh
from gvla2.geometry.transform import FloatArray, look_along
from gvla2.geometry.views import View, Views
from gvla2.io.array_cache import cache_folder, cached_arrays

VERSION = "gso30-views-2"
"""Changes whenever a rendered view would: it is part of the cache's keys and of a bench's results."""
CAMERAS = 25
INPUTS = tuple(range(5))
TARGETS = tuple(range(10, 25))
FOCAL = 35 / 32
"""Focal length in image widths."""
SIZE = 256
SAMPLES = 4
"""Rays along a pixel's side: 512 x 512 with 2 x 2 rays, averaged to 256 x 256."""


@dataclass(frozen=True)
class ObjectViews:
    """One object of an evaluation: a method's inputs, its targets, and the true shape.

    All in one frame (longest side 1, centred, Z-up). ``inputs`` and ``targets`` have masks; ``inputs`` have depth
    when the views were rendered here. ``mesh`` is None when the data set has no true shape.
    """

    name: str
    inputs: Views
    targets: Views
    mesh: TriangleMesh | None


def protocol_cameras(name: str, size: int = SIZE) -> tuple[Camera, ...]:
    """The 25 cameras of the object called ``name``, pictures of ``size`` x ``size`` pixels."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
    rng = np.random.default_rng(seed)
    K = np.array([[FOCAL * size, 0, size / 2], [0, FOCAL * size, size / 2], [0, 0, 1.0]])
    cameras = []
    for index in range(CAMERAS):
        if index == 0:
            radius, height = rng.uniform(1.7, 2.0), rng.uniform(0.9, 1.1)
        else:
            radius = rng.uniform(1.5, 2.2)
            height = radius * rng.uniform(-1, 1)  # uniform over the sphere (Archimedes)
        turn, flat = rng.uniform(0, 2 * np.pi), np.sqrt(radius**2 - height**2)
        position = np.array([flat * np.cos(turn), flat * np.sin(turn), height])
        cameras.append(Camera(K, look_along(position, -position), size, size, f"{index:03d}"))
    return tuple(cameras)


def object_views(
    path: str | os.PathLike[str],
    name: str | None = None,
    *,
    size: int = SIZE,
    samples: int = SAMPLES,
    cache: Path | None = None,
) -> ObjectViews:
    """The object of a mesh file under the protocol; rendered once, then read from the cache.

    ``name`` (the file's folder by default) chooses the cameras. A cache that cannot be written only costs time; a
    damaged entry is remade. Raises :class:`GeometryError` for a file that is not a mesh.
    """
    from gvla2.evaluation.textured_views import textured_view

    textured = read_textured_mesh(path).normalised()
    name = name or Path(path).absolute().parent.name
    used = (*INPUTS, *TARGETS)
    cameras = protocol_cameras(name, size)
    chosen = [cameras[index] for index in used]
    key = f"{VERSION}|{name}|{size}|{samples}|{textured.content_hash()}"

    def rendered() -> dict[str, FloatArray]:
        made = [textured_view(textured, camera, samples) for camera in chosen]
        return {part: np.stack([getattr(view, part) for view in made]) for part in ("image", "depth", "mask")}

    folder = (cache_folder() if cache is None else cache) / "views"
    stored = cached_arrays(folder, key, rendered, compressed=True)
    rows = zip(chosen, stored["image"], stored["depth"], stored["mask"], strict=True)
    views = tuple(View(*row) for row in rows)
    split = len(INPUTS)
    return ObjectViews(name, Views(views[:split]), Views(views[split:]), textured.mesh)
