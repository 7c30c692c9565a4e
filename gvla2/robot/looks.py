"""Visual surfaces of the robot, the table and a task's bodies for the ray caster."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from gvla2.errors import GeometryError, RobotError
from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.raycast import RayCaster, RayImage, Surface
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.geometry.urdf_files import numbers, origin_of, paint_of
from gvla2.io.array_cache import cache_folder, cached_arrays
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Primitive, Solid

CELL = 0.004
"""Detail of the robot's looks, metres: 2 to 10 thousand triangles a link. Coarser cells let the dark shells under
the white ones show through, and cast hardly faster."""

OWN_DEPTH = 0.010
"""Depth counts as the robot's own within this distance of its model, metres."""

GREY = (0.7, 0.7, 0.7)

_SEGMENTS = 48
_VERSION = 4
"""Changes whenever a thinned mesh would: it is part of the cache's keys."""


def link_surfaces(robot: ET.Element, drawn: bool = True) -> dict[str, Surface]:
    """A surface for each link of a URDF (meshes by full paths) that has a shape, by name, in the link's frame.

    ``drawn``: its simplified visuals, if any; else its full collision shapes.
    """
    surfaces = {}
    for link in robot.iterfind("link"):
        solids = (link.findall("visual") if drawn else []) or link.findall("collision")
        shapes = [shape for shape in (_shape(solid, robot, drawn) for solid in solids) if shape is not None]
        if shapes:
            surfaces[link.get("name", "")] = joined(shapes, identity=0)
    return surfaces


def _shape(solid: ET.Element, robot: ET.Element, thinned: bool) -> Surface | None:
    """One visual or collision of a link, in the link's frame; its own colour, else its material's, else grey."""
    paint = paint_of(solid, robot)
    rgb: Any = GREY if paint is None else tuple(paint.tolist())
    shape = solid.find("geometry/*")
    if shape is not None and shape.tag == "mesh":
        surface = _read_mesh(Path(shape.get("filename", "")), rgb, thinned)
        scale = numbers(shape, "scale", (1.0, 1.0, 1.0))
        faces = surface.faces[:, ::-1] if scale.prod() < 0 else surface.faces  # mirrored
        surface = replace(surface, vertices=surface.vertices * scale, faces=faces)
    elif shape is not None and shape.tag in ("box", "cylinder", "sphere"):
        size = numbers(shape, "size", 2 * numbers(shape, "radius", (0.0,)).repeat(3))
        size[2] = numbers(shape, "length", size[2:])[0]
        kind: Any = shape.tag
        surface = _solid(Primitive(kind, tuple(size.tolist()), rgb))
    else:
        return None
    if not len(surface.faces):
        return None
    return replace(surface, vertices=transform_points(origin_of(solid), surface.vertices))


@lru_cache(maxsize=64)
def _read_mesh(path: Path, rgb: tuple[float, ...], thinned: bool) -> Surface:
    """A file's triangles in its own colours, else in ``rgb``; ``thinned`` ones come from the cache where they are."""

    def load() -> dict[str, NDArray[Any]]:
        try:
            textured = read_textured_mesh(path, up="z")
        except GeometryError as error:
            raise RobotError(str(error)) from error
        mesh = textured.mesh
        colours = textured.face_colours if textured.has_colours else np.tile(rgb, (len(mesh.faces), 1))
        if not thinned:
            return {"vertices": mesh.vertices, "faces": mesh.faces, "rgb": colours}
        coarse, kept = TriangleMesh(mesh.vertices, mesh.faces).clustered(CELL)
        return {"vertices": coarse.vertices, "faces": coarse.faces, "rgb": colours[kept]}

    if not thinned:
        made = load()
        return Surface(made["vertices"], made["faces"], made["rgb"], id=0)
    key = f"{_VERSION} {CELL} {rgb} {path.suffix} {hashlib.sha256(path.read_bytes()).hexdigest()}"
    made = cached_arrays(cache_folder() / "looks", key, load)
    return Surface(made["vertices"], made["faces"], made["rgb"], id=0)


class RobotLooks:
    """A robot's links as surfaces, for its own pixels in a camera's pictures."""

    def __init__(self, surfaces: Mapping[str, Surface]) -> None:
        self.links = tuple(surfaces)
        self._caster = RayCaster(list(surfaces.values()))

    def cast(self, cameras: Sequence[Camera], world_from_link: Mapping[str, FloatArray]) -> list[RayImage]:
        """What the cameras would see of the robot alone; poses (4, 4) by link."""
        return self._caster.cast(cameras, {i: world_from_link[link] for i, link in enumerate(self.links)})


def body_surface(body: Body) -> Surface:
    """A body's solids as one surface in the body's frame; its texture where it is a single mesh."""
    if len(body.solids) == 1 and isinstance(body.solids[0], Scan):
        scan = body.solids[0]
        mesh = scan.textured.mesh
        vertices = transform_points(scan.body_from_shape, mesh.vertices)
        return Surface(vertices, mesh.faces, scan.textured.rgb.mean(axis=1), 1, scan.texture)
    return joined([_solid(solid) for solid in body.solids], identity=1)


def _solid(solid: Solid) -> Surface:
    if isinstance(solid, Scan):
        mesh = solid.textured.mesh
        return Surface(
            transform_points(solid.body_from_shape, mesh.vertices), mesh.faces, solid.face_colours, 0
        )
    if solid.kind == "box":
        shape = trimesh.creation.box(extents=solid.size)
    elif solid.kind == "cylinder":
        shape = trimesh.creation.cylinder(0.5 * solid.size[0], height=solid.size[2], sections=_SEGMENTS)
    else:
        shape = trimesh.creation.icosphere(subdivisions=3, radius=0.5 * solid.size[0])
    faces = np.asarray(shape.faces, dtype=np.int64)
    vertices = transform_points(solid.body_from_shape, shape.vertices)
    return Surface(vertices, faces, np.tile(solid.rgb, (len(faces), 1)), 0)


def joined(surfaces: Sequence[Surface], identity: int) -> Surface:
    """One surface of all."""
    starts = np.cumsum([0, *(len(s.vertices) for s in surfaces)])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + start for s, start in zip(surfaces, starts, strict=False)]),
        np.concatenate([s.rgb for s in surfaces]),
        identity,
    )
