"""Known objects with joints: the looks of a URDF's links at rest, and how they move."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import GREY, TexturedMesh, TriangleMesh
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.geometry.urdf_files import SLIDES, find_beside, link_of, numbers, origin_of, paint_of, parse_urdf


@dataclass(frozen=True)
class Visual:
    """One ``shape`` of a link, placed by ``object_from_shape`` (4, 4): its mesh ``file`` (None for a primitive), the
    moving link that it belongs to (see :class:`ArticulatedFile`), and its material's colour (3,) in [0, 1].
    """

    shape: ET.Element
    file: Path | None
    object_from_shape: FloatArray
    link: int
    rgb: FloatArray | None


@dataclass(frozen=True)
class MovingLink:
    """A link that moves, with all that is fixed to it: its name and joint; ``axis`` and ``origin`` (3,) in the object's
    frame with all joints at zero, ``low`` and ``high`` in metres or radians.
    """

    name: str
    slides: bool
    axis: FloatArray
    origin: FloatArray
    low: float
    high: float


@dataclass(frozen=True)
class ArticulatedFile:
    """What a URDF says: its visuals, and the links that move; a visual's ``link`` is an index of these, -1 for none."""

    path: Path
    visuals: tuple[Visual, ...]
    links: tuple[MovingLink, ...]

    @property
    def files(self) -> frozenset[Path]:
        """The meshes that it refers to."""
        return frozenset(visual.file for visual in self.visuals if visual.file is not None)

    def meshes(self) -> list[tuple[int, TexturedMesh]]:
        """The visuals in the object's frame, all joints at zero, each with its link; raises :class:`GeometryError`."""
        return [(visual.link, _mesh(self.path, visual)) for visual in self.visuals]


def read_articulated(path: str | os.PathLike[str]) -> ArticulatedFile:
    """The structure of a URDF, whose meshes lie beside it; raises :class:`GeometryError` for what is none."""
    path = Path(path)
    robot = parse_urdf(path)
    above = {link_of(joint, "child"): joint for joint in robot.iterfind("joint")}
    poses: dict[str, FloatArray] = {}
    owners: dict[str, str] = {}

    def place(link: str) -> FloatArray:
        """object_from_link (4, 4) with all joints at zero."""
        if link not in poses:
            joint = above.get(link)
            if joint is None:
                poses[link], owners[link] = np.eye(4), ""
            else:
                parent = link_of(joint, "parent")
                poses[link] = place(parent) @ origin_of(joint)
                owners[link] = link if joint.get("type") in SLIDES else owners[parent]
        return poses[link]

    links = {link.get("name", ""): link for link in robot.iterfind("link")}
    for name in links:
        place(name)
    moving = [name for name in links if owners[name] == name]
    numbers_of = {name: number for number, name in enumerate(moving)}
    visuals = tuple(
        _visual(visual, robot, poses[name], numbers_of.get(owners[name], -1), path)
        for name, link in links.items()
        for visual in link.iterfind("visual")
    )
    if not visuals:
        raise GeometryError(f"{path} has no <visual>: there is nothing to recognise it by.")
    return ArticulatedFile(path, visuals, tuple(_moving(name, above[name], poses[name]) for name in moving))


def _moving(name: str, joint: ET.Element, pose: FloatArray) -> MovingLink:
    axis, limit = numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0)), joint.find("limit")
    low, high = -np.pi, np.pi
    if joint.get("type") != "continuous":
        low, high = (float(numbers(limit, bound, (0.0,))[0]) for bound in ("lower", "upper"))
    slides = SLIDES[joint.get("type", "")]
    return MovingLink(name, slides, pose[:3, :3] @ axis / np.linalg.norm(axis), pose[:3, 3], low, high)


def _visual(visual: ET.Element, robot: ET.Element, pose: FloatArray, link: int, path: Path) -> Visual:
    shape = visual.find("geometry/*")
    if shape is None:
        raise GeometryError(f"{path}: a <visual> has no shape.")
    file = None
    if shape.tag == "mesh":
        file = find_beside(path, shape.get("filename", ""))
        if file is None:
            raise GeometryError(
                f"{path}: its mesh {shape.get('filename')} does not exist; put it beside the file."
            )
    return Visual(shape, file, pose @ origin_of(visual), link, paint_of(visual, robot))


def _mesh(path: Path, visual: Visual) -> TexturedMesh:
    shape, paint = visual.shape, visual.rgb
    if visual.file is not None:
        read, scale = read_textured_mesh(visual.file, up="z"), numbers(shape, "scale", (1.0, 1.0, 1.0))
        vertices = transform_points(visual.object_from_shape, read.mesh.vertices * scale)
        placed = replace(read, mesh=read.mesh.with_vertices(vertices))
        placed = placed.flipped() if scale.prod() < 0 else placed  # mirrored
        return placed if paint is None or read.has_colours else placed.painted(paint)
    if shape.tag == "box":
        made = trimesh.creation.box(numbers(shape, "size", ()))
    elif shape.tag == "sphere":
        made = trimesh.creation.icosphere(radius=numbers(shape, "radius", ())[0])
    elif shape.tag == "cylinder":
        made = trimesh.creation.cylinder(*(numbers(shape, name, ())[0] for name in ("radius", "length")))
    else:
        raise GeometryError(
            f"{path}: a <{shape.tag}> cannot be drawn; a URDF has meshes, boxes, cylinders, spheres."
        )
    faces = np.asarray(made.faces)
    mesh = TriangleMesh(transform_points(visual.object_from_shape, made.vertices), faces)
    rgb = np.full((*faces.shape, 3), GREY, dtype=np.float32)
    plain = TexturedMesh(mesh, np.zeros((*faces.shape, 2), np.float32), np.full(len(faces), -1), rgb, ())
    return plain if paint is None else plain.painted(paint)
