"""Known objects with joints: the looks of a URDF's links at rest, and how they move."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import GREY, TexturedMesh, TriangleMesh
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.transform import FloatArray, rigid, transform_points

MOVING = {"prismatic": True, "revolute": False, "continuous": False}
"""Types of joints that move, and whether they slide."""


@dataclass(frozen=True)
class Visual:
    """One ``shape`` of a link, placed by ``object_from_shape`` (4, 4): its mesh ``file`` (None for a primitive), the
    moving link that it belongs to (see :class:`ArticulatedFile`), and the colour (3,) in [0, 1] of a primitive.
    """

    shape: ET.Element
    file: Path | None
    object_from_shape: FloatArray
    link: int
    rgb: FloatArray


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
    try:
        robot = ET.parse(path).getroot()
    except (OSError, ET.ParseError, UnicodeDecodeError) as error:
        raise GeometryError(f"Cannot read {path} as a URDF: {error}") from error
    if robot.tag != "robot":
        raise GeometryError(f"{path} is no URDF: its root is <{robot.tag}>, not <robot>.")
    above = {_named(joint, "child", path): joint for joint in robot.iterfind("joint")}
    poses: dict[str, FloatArray] = {}
    owners: dict[str, str] = {}

    def place(link: str, below: tuple[str, ...] = ()) -> FloatArray:
        """object_from_link (4, 4) with all joints at zero."""
        if link in below:
            raise GeometryError(f"{path}: the joints of link '{link}' form a circle.")
        if link not in poses:
            joint = above.get(link)
            if joint is None:
                poses[link], owners[link] = np.eye(4), ""
            else:
                parent = _named(joint, "parent", path)
                poses[link] = place(parent, (*below, link)) @ _origin(joint, path)
                owners[link] = link if joint.get("type") in MOVING else owners[parent]
        return poses[link]

    links = {link.get("name", ""): link for link in robot.iterfind("link")}
    for name in links:
        place(name)
    moving = [name for name in links if owners[name] == name and name]
    numbers = {name: number for number, name in enumerate(moving)}
    visuals = tuple(
        _visual(visual, robot, poses[name], numbers.get(owners[name], -1), path)
        for name, link in links.items()
        for visual in link.iterfind("visual")
    )
    if not visuals:
        raise GeometryError(f"{path} has no <visual>: there is nothing to recognise it by.")
    return ArticulatedFile(
        path, visuals, tuple(_moving(name, above[name], poses[name], path) for name in moving)
    )


def _moving(name: str, joint: ET.Element, pose: FloatArray, path: Path) -> MovingLink:
    axis, limit = _numbers(joint.find("axis"), "xyz", path, (1.0, 0.0, 0.0)), joint.find("limit")
    length = float(np.linalg.norm(axis))
    if not length > 0:
        raise GeometryError(f"{path}: the axis of joint '{joint.get('name')}' is 0.")
    low, high = -np.pi, np.pi
    if joint.get("type") != "continuous":
        if limit is None:
            raise GeometryError(f"{path}: joint '{joint.get('name')}' has no <limit>.")
        low, high = (float(_numbers(limit, bound, path, (0.0,))[0]) for bound in ("lower", "upper"))
    slides = MOVING[joint.get("type", "")]
    return MovingLink(name, slides, pose[:3, :3] @ axis / length, pose[:3, 3], low, high)


def _visual(visual: ET.Element, robot: ET.Element, pose: FloatArray, link: int, path: Path) -> Visual:
    shape, material = visual.find("geometry/*"), visual.find("material")
    if shape is None:
        raise GeometryError(f"{path}: a <visual> has no shape.")
    file = None
    if shape.tag == "mesh":
        name = shape.get("filename", "").removeprefix("package://").removeprefix("file://")
        file = next((each / name for each in path.absolute().parents if (each / name).is_file()), None)
        if file is None:
            raise GeometryError(
                f"{path}: its mesh {shape.get('filename')} does not exist; put it beside the file."
            )
    paint = None
    if material is not None:  # its own colour, or that of the robot's material of its name
        named = (each for each in robot.iterfind("material") if each.get("name") == material.get("name"))
        paint = next((c for each in (material, *named) if (c := each.find("color")) is not None), None)
    rgb = np.clip(_numbers(paint, "rgba", path, (GREY, GREY, GREY, 1.0))[:3], 0.0, 1.0)
    return Visual(shape, file, pose @ _origin(visual, path), link, rgb)


def _mesh(path: Path, visual: Visual) -> TexturedMesh:
    shape = visual.shape
    if visual.file is not None:
        read, scale = read_textured_mesh(visual.file, up="z"), _numbers(shape, "scale", path, (1.0, 1.0, 1.0))
        vertices = transform_points(visual.object_from_shape, read.mesh.vertices * scale)
        return replace(read, mesh=read.mesh.with_vertices(vertices))
    if shape.tag == "box":
        made = trimesh.creation.box(_numbers(shape, "size", path, (np.nan,) * 3))
    elif shape.tag in ("cylinder", "sphere"):
        radius = float(_numbers(shape, "radius", path, (np.nan,))[0])
        if shape.tag == "sphere":
            made = trimesh.creation.icosphere(radius=radius)
        else:
            made = trimesh.creation.cylinder(radius, float(_numbers(shape, "length", path, (np.nan,))[0]))
    else:
        raise GeometryError(
            f"{path}: a <{shape.tag}> cannot be drawn; a URDF has meshes, boxes, cylinders, spheres."
        )
    faces = np.asarray(made.faces)
    mesh = TriangleMesh(transform_points(visual.object_from_shape, made.vertices), faces)
    rgb = np.tile(visual.rgb.astype(np.float32), (*faces.shape, 1))
    return TexturedMesh(mesh, np.zeros((*faces.shape, 2), np.float32), np.full(len(faces), -1), rgb, ())


def _origin(element: ET.Element, path: Path) -> FloatArray:
    shift, turn = (_numbers(element.find("origin"), name, path, (0.0, 0.0, 0.0)) for name in ("xyz", "rpy"))
    return rigid(Rotation.from_euler("xyz", turn).as_matrix(), shift)


def _named(joint: ET.Element, end: str, path: Path) -> str:
    element = joint.find(end)
    if element is None or not element.get("link"):
        raise GeometryError(f"{path}: joint '{joint.get('name')}' has no {end} link.")
    return element.get("link", "")


def _numbers(element: ET.Element | None, name: str, path: Path, usual: Sequence[float]) -> FloatArray:
    """The numbers of an attribute, as many as the ``usual`` ones, which stand for an absent one; NaN: it is needed."""
    given = None if element is None else element.get(name)
    try:
        numbers = np.array([float(word) for word in given.split()] if given else usual)
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != len(usual) or not np.isfinite(numbers).all():
        tag = "" if element is None else element.tag
        raise GeometryError(f'{path}: <{tag} {name}="{given}"> needs {len(usual)} finite numbers.')
    return numbers
