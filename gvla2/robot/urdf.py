"""Reading an arm's URDF: its files, its errors, and its changes for simulation."""

from __future__ import annotations

import hashlib
import os
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from copy import deepcopy
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, PackagePath, distribution
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from gvla2.errors import GeometryError, MissingDependencyError, RobotError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh, write_mesh
from gvla2.io.array_cache import cache_folder

PACKAGE = "package://"
_DESCRIPTIONS = "example-robot-data"
_XACRO = "{http://www.ros.org/wiki/xacro}"


def find_file(name: str, option: str) -> Path:
    """The file that an option names: a path, or ``package://`` and an installed package."""
    path = _in_package(name) if name.startswith(PACKAGE) else Path(name).expanduser()
    if path is None or not path.is_file():
        where = "in no installed package's files" if path is None else "no file"
        raise RobotError(
            f"{option}={name} is {where}. Give the path of a file, or package://PACKAGE/PATH of a package that pip or "
            "ROS has installed (ROS_PACKAGE_PATH)."
        )
    return path.absolute()


def read_urdf(path: Path) -> ET.Element:
    """The ``robot`` element of a file, ready for kinematics and simulation.

    Meshes get their full paths; continuous joints get limits of a turn either way; links with only visuals collide by
    these. Raises :class:`RobotError` for a file that is not a URDF, for a missing mesh, and if no link has a shape.
    """
    try:
        robot = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise RobotError(f"{path} is not XML ({error}); robot.urdf needs a URDF.") from error
    if robot.tag != "robot" or any(str(e.tag).startswith(_XACRO) for e in robot.iter()):
        raise RobotError(
            f"{path} has a <{robot.tag}> with xacro in it or is no <robot>; robot.urdf needs a plain URDF. "
            "`xacro FILE.xacro > FILE.urdf` makes one."
        )
    for link in robot.iterfind("link"):
        name = link.get("name", "")
        if any(len(geometry) != 1 for geometry in link.iter("geometry")):
            raise RobotError(
                f"A <geometry> of link {name} in {path} does not hold one shape: give it a box, a cylinder, a sphere "
                "or a mesh, or take out its <visual> or <collision>."
            )
        for mesh in link.iter("mesh"):
            mesh.set("filename", str(find_mesh(path, mesh.get("filename", ""), name)))
        if link.find("collision") is None:
            for visual in link.findall("visual"):
                collision = ET.SubElement(link, "collision")
                collision.extend(deepcopy(e) for e in visual if e.tag in ("origin", "geometry"))
        for mesh in link.iterfind("collision/geometry/mesh"):
            if mesh.get("filename", "").lower().endswith(".dae"):
                mesh.set("filename", str(_as_obj(Path(mesh.get("filename", "")))))
    names = {link.get("name") for link in robot.iterfind("link")}
    named = [(j, "name") for j in robot.iterfind("joint")] + [(m, "joint") for m in robot.iter("mimic")]
    for element, key in named:
        if element.get(key) in names:  # pinocchio does not distinguish the two
            element.set(key, f"{element.get(key)}_joint")
    for joint in robot.iterfind("joint[@type='continuous']"):
        joint.set("type", "revolute")
        limit = joint.find("limit")
        limit = ET.SubElement(joint, "limit", effort="100", velocity="2") if limit is None else limit
        limit.attrib.update(lower=str(-2 * np.pi), upper=str(2 * np.pi))
    if robot.find("link/collision") is None:
        raise RobotError(
            f"None of the {len(robot.findall('link'))} links of {path} has a <collision> or <visual>: there is nothing "
            "to see or to touch. Use a URDF with meshes, boxes or cylinders."
        )
    return robot


def freeze(robot: ET.Element, links: Collection[str], moving: Collection[str]) -> None:
    """Fix the joints, at zero, that neither carry ``links`` nor are ``moving``: another arm, a hand not used."""
    above = {link_of(j, "child"): j for j in robot.iterfind("joint")}
    chain = set(moving)
    for link in links:
        while link in above:
            chain.add(above[link].get("name", ""))
            link = link_of(above[link], "parent")
    for joint in above.values():
        if joint.get("name") not in chain:
            joint.set("type", "fixed")
            for mimic in joint.findall("mimic"):
                joint.remove(mimic)


def find_mesh(urdf: Path, filename: str, link: str = "") -> Path:
    """The file of a mesh name in a URDF.

    It is absolute, relative to the URDF, or ``package://`` under one of the URDF's parents or of an installed package.
    """
    name = filename.removeprefix("file://").removeprefix(PACKAGE)
    found = next((p / name for p in urdf.absolute().parents if (p / name).is_file()), None)
    found = found or (_in_package(filename) if filename.startswith(PACKAGE) else None)
    if found is None:
        raise RobotError(
            f"The mesh {filename} of {f'link {link} in ' if link else ''}{urdf} does not exist. Looked for {name} "
            "beside the file, in the folders above it and in installed packages: put it there, or fix the path."
        )
    return found


def without_looks(robot: ET.Element) -> str:
    """The text without visuals and materials, whose loading needs Vulkan."""
    bare = ET.fromstring(ET.tostring(robot))
    for parent, tag in ((p, tag) for p in [bare, *bare.findall("link")] for tag in ("material", "visual")):
        for child in parent.findall(tag):
            parent.remove(child)
    return ET.tostring(bare, encoding="unicode")


def link_of(joint: ET.Element, end: str) -> str:
    """The name of a joint's ``parent`` or ``child`` link."""
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _as_obj(collada: Path) -> Path:
    """A COLLADA file's triangles in metres as an OBJ file in the cache.

    Collision checkers and simulators disagree on the unit and the nodes of COLLADA; an OBJ file they read alike.
    """
    try:
        content = collada.read_bytes()
        target = cache_folder() / "collision" / f"{hashlib.sha256(content).hexdigest()[:32]}.obj"
        if not target.is_file():
            mesh = read_mesh(collada, up="z")
            target.parent.mkdir(parents=True, exist_ok=True)
            write_mesh(target, TriangleMesh(mesh.vertices, mesh.faces))
    except (OSError, GeometryError) as error:
        raise RobotError(f"The collision mesh {collada} can't be prepared: {error}") from error
    return target


@lru_cache
def _in_package(name: str) -> Path | None:
    """The file of ``package://PACKAGE/PATH``: in ROS's folders, an installed distribution or a Python package."""
    package, _, rest = name.removeprefix(PACKAGE).partition("/")
    for folder in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        for root in (Path(folder), Path(folder) / package):
            if root.name == package and (root / rest).is_file():
                return root / rest
    files: Sequence[PackagePath] = ()
    try:
        files = distribution(package).files or ()
    except PackageNotFoundError:
        if package == _DESCRIPTIONS:
            needs = f"The robot's description ({name})"
            raise MissingDependencyError(_DESCRIPTIONS, needs, 'pip install "gvla2[arms]"') from None
    found = next((f for f in files if str(f).endswith(f"/{package}/{rest}")), None)
    if found is not None:
        return Path(str(found.locate())).resolve()
    spec = find_spec(package) if package.isidentifier() else None
    folders = (spec.submodule_search_locations if spec else None) or []
    return next((Path(f) / rest for f in folders if (Path(f) / rest).is_file()), None)
