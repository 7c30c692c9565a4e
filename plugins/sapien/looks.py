"""What the robot, the table and a task's bodies look like: surfaces for the ray caster."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.errors import RobotError
from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Solid
from gvla2_plugins.sapien.collada import PaintedMesh, read_collada, thin

CELL = 0.004
"""Detail of the robot's looks, metres: 2 to 10 thousand triangles a link. Coarser cells let the dark shells under
the white ones show through, and cast hardly faster."""

_SEGMENTS = 48


@lru_cache(maxsize=4)
def robot_surfaces(urdf: Path) -> dict[str, Surface]:
    """A surface for each link of a URDF that has visual meshes (COLLADA), by link name, in the link's frame."""
    surfaces = {}
    for link in ET.parse(urdf).getroot().iterfind("link"):
        meshes = []
        for visual in link.iterfind("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            painted = thin(read_collada(find_mesh(urdf, mesh.get("filename", ""))), CELL)
            moved = transform_points(_origin(visual.find("origin")), painted.vertices)
            meshes.append(PaintedMesh(moved, painted.faces, painted.rgb))
        if meshes:
            surfaces[link.get("name", "")] = _surface(meshes, identity=0)
    return surfaces


def body_surface(body: Body) -> Surface:
    """A body's solids as one surface in the body's frame; its texture where it is a single mesh."""
    if len(body.solids) == 1 and isinstance(body.solids[0], Scan):
        scan = body.solids[0]
        mesh = scan.textured.mesh
        vertices = transform_points(scan.body_from_shape, mesh.vertices)
        return Surface(vertices, mesh.faces, scan.textured.rgb.mean(axis=1), 1, scan.texture)
    return _surface([_solid(solid) for solid in body.solids], identity=1)


def find_mesh(urdf: Path, filename: str) -> Path:
    """The file that a URDF's mesh name means: relative to the URDF, or ``package://`` under one of its parents."""
    name = filename.removeprefix("package://")
    found = next((p / name for p in urdf.absolute().parents if (p / name).is_file()), None)
    if found is None:
        raise RobotError(f"The mesh {filename} of {urdf} does not exist; reinstall the robot's description.")
    return found


def _solid(solid: Solid) -> PaintedMesh:
    if isinstance(solid, Scan):
        mesh = solid.textured.mesh
        vertices = transform_points(solid.body_from_shape, mesh.vertices)
        return PaintedMesh(vertices, mesh.faces, solid.face_colours)
    if solid.kind == "box":
        mesh = trimesh.creation.box(extents=solid.size)
    elif solid.kind == "cylinder":
        mesh = trimesh.creation.cylinder(0.5 * solid.size[0], height=solid.size[2], sections=_SEGMENTS)
    else:
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.5 * solid.size[0])
    faces = np.asarray(mesh.faces, dtype=np.int64)
    vertices = transform_points(solid.body_from_shape, mesh.vertices)
    return PaintedMesh(vertices, faces, np.tile(solid.rgb, (len(faces), 1)))


def _surface(meshes: Sequence[PaintedMesh], identity: int) -> Surface:
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    return Surface(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=False)]),
        np.concatenate([m.rgb for m in meshes]),
        identity,
    )


def _origin(element: ET.Element | None) -> FloatArray:
    """(4, 4) of a URDF ``origin``."""
    if element is None:
        return np.eye(4)
    xyz = np.array(element.get("xyz", "0 0 0").split(), dtype=np.float64)
    rpy = np.array(element.get("rpy", "0 0 0").split(), dtype=np.float64)
    return rigid(Rotation.from_euler("xyz", rpy).as_matrix(), xyz)
