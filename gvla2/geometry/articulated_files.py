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
    """One shape of a link: ``file`` (None for a primitive), its vertices scaled, placed by ``object_from_shape``.

    ``rgb`` (3,) in [0, 1] paints a primitive.
    """

    element: ET.Element
    file: Path | None
    scale: FloatArray
    object_from_shape: FloatArray
    link: int
    rgb: tuple[float, float, float] = (GREY, GREY, GREY)


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

    names = [link.get("name", "") for link in robot.iterfind("link")]
    for name in names:
        place(name)
    moving = [name for name in names if owners[name] == name and name]
    visuals = tuple(
        replace(
            _visual(visual, path, place(link.get("name", "")), moving, owners[link.get("name", "")]),
            rgb=_paint(visual, robot, path),
        )
        for link in robot.iterfind("link")
        for visual in link.iterfind("visual")
    )
    if not visuals:
        raise GeometryError(f"{path} has no <visual>: there is nothing to recognise it by.")
    return ArticulatedFile(
        path, visuals, tuple(_moving(name, above[name], poses[name], path) for name in moving)
    )


def _moving(name: str, joint: ET.Element, pose: FloatArray, path: Path) -> MovingLink:
    axis_element, limit = joint.find("axis"), joint.find("limit")
    axis = np.array([1.0, 0.0, 0.0]) if axis_element is None else _numbers(axis_element, "xyz", 3, path)
    length = float(np.linalg.norm(axis))
    if not length > 0:
        raise GeometryError(f"{path}: the axis of joint '{joint.get('name')}' is 0.")
    low, high = -np.pi, np.pi
    if joint.get("type") != "continuous":
        if limit is None:
            raise GeometryError(f"{path}: joint '{joint.get('name')}' has no <limit>.")
        low, high = (
            float(_numbers(limit, bound, 1, path)[0]) if limit.get(bound) else 0.0
            for bound in ("lower", "upper")
        )
    return MovingLink(
        name,
        MOVING[joint.get("type", "")],
        pose[:3, :3] @ axis / length,
        pose[:3, 3],
        low,
        high,
    )


def _visual(visual: ET.Element, path: Path, pose: FloatArray, moving: Sequence[str], owner: str) -> Visual:
    shape = next(iter(visual.find("geometry") or ()), None)
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
    scale = _numbers(shape, "scale", 3, path) if shape.get("scale") else np.ones(3)
    link = moving.index(owner) if owner else -1
    return Visual(shape, file, scale, pose @ _origin(visual, path), link)


def _paint(visual: ET.Element, robot: ET.Element, path: Path) -> tuple[float, float, float]:
    """The colour of a visual's material, its own or that of the robot's by its name; grey without one."""
    material = visual.find("material")
    if material is None:
        return GREY, GREY, GREY
    named = (each for each in robot.iterfind("material") if each.get("name") == material.get("name"))
    colour = next((c for each in (material, *named) if (c := each.find("color")) is not None), None)
    if colour is None:
        return GREY, GREY, GREY
    red, green, blue, _ = np.clip(_numbers(colour, "rgba", 4, path), 0.0, 1.0).tolist()
    return red, green, blue


def _mesh(path: Path, visual: Visual) -> TexturedMesh:
    shape = visual.element
    if visual.file is not None:
        read = read_textured_mesh(visual.file, up="z")
        vertices = transform_points(visual.object_from_shape, read.mesh.vertices * visual.scale)
        return replace(read, mesh=read.mesh.with_vertices(vertices))
    if shape.tag == "box":
        made = trimesh.creation.box(_numbers(shape, "size", 3, path))
    elif shape.tag == "cylinder":
        made = trimesh.creation.cylinder(
            float(_numbers(shape, "radius", 1, path)[0]), float(_numbers(shape, "length", 1, path)[0])
        )
    elif shape.tag == "sphere":
        made = trimesh.creation.icosphere(radius=float(_numbers(shape, "radius", 1, path)[0]))
    else:
        raise GeometryError(
            f"{path}: a <{shape.tag}> cannot be drawn; a URDF has meshes, boxes, cylinders, spheres."
        )
    faces = np.asarray(made.faces)
    mesh = TriangleMesh(transform_points(visual.object_from_shape, made.vertices), faces)
    rgb = np.tile(np.array(visual.rgb, dtype=np.float32), (*faces.shape, 1))
    return TexturedMesh(mesh, np.zeros((*faces.shape, 2), np.float32), np.full(len(faces), -1), rgb, ())


def _origin(element: ET.Element, path: Path) -> FloatArray:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    shift, turn = (
        _numbers(origin, name, 3, path) if origin.get(name) else np.zeros(3) for name in ("xyz", "rpy")
    )
    return rigid(Rotation.from_euler("xyz", turn).as_matrix(), shift)


def _named(joint: ET.Element, end: str, path: Path) -> str:
    element = joint.find(end)
    if element is None or not element.get("link"):
        raise GeometryError(f"{path}: joint '{joint.get('name')}' has no {end} link.")
    return element.get("link", "")


def _numbers(element: ET.Element, name: str, count: int, path: Path) -> FloatArray:
    try:
        numbers = np.array([float(word) for word in element.get(name, "").split()])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise GeometryError(
            f'{path}: <{element.tag} {name}="{element.get(name)}"> needs {count} finite numbers.'
        )
    return numbers
