"""Reading an arm's URDF: its files, its errors, and its changes for simulation."""

from __future__ import annotations

import hashlib
import logging
import os
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from copy import deepcopy
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, PackagePath, distribution
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from gvla2.errors import MissingDependencyError, RobotError, reading
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh, write_mesh
from gvla2.geometry.urdf_files import SLIDES, find_beside, link_of, mesh_name, numbers, parse_urdf
from gvla2.io.array_cache import cache_folder

PACKAGE = "package://"
_DESCRIPTIONS = "example-robot-data"
TURNING_SPEED, SLIDING_SPEED, EFFORT = 2.0, 0.1, 100.0
"""What joints get that state no speed (rad/s; m/s) and no force (Nm; N)."""
_USUAL_SPEEDS = (
    f"they get {TURNING_SPEED:g} rad/s, sliding ones {SLIDING_SPEED:g} m/s; state <limit velocity=...>"
)

_AXES = ("xx", "yy", "zz", "xy", "xz", "yz")

log = logging.getLogger(__name__)


def find_file(name: str, option: str) -> Path:
    """The file that an option names: a path, or ``package://`` and an installed package."""
    path = _in_package(name) if name.startswith(PACKAGE) else Path(name).expanduser()
    if path is None or not path.is_file():
        where = "in no installed package's files" if path is None else "no file"
        raise RobotError(
            f"{option}={name} is {where}. Give the path of a file, or package://PACKAGE/PATH of a package that pip or "
            "ROS has installed (ROS_PACKAGE_PATH, AMENT_PREFIX_PATH)."
        )
    return path.absolute()


def read_urdf(path: Path) -> ET.Element:
    """The ``robot`` element of a file, ready for kinematics and simulation.

    Meshes get their full paths; continuous joints get limits of a turn either way, and joints without a speed or a
    force usual ones; links with only visuals collide by these; masses and inertias that no body has are left out.
    Raises :class:`RobotError` for a file that is not a
    URDF (:func:`gvla2.geometry.urdf_files.parse_urdf`), for a missing mesh, and if no link has a shape.
    """
    with reading("a URDF", path, RobotError):
        return _prepared(parse_urdf(path), path)


def _prepared(robot: ET.Element, path: Path) -> ET.Element:
    """The ``robot`` of a file, changed as :func:`read_urdf` says."""
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
            mesh.set("filename", str(_as_obj(Path(mesh.get("filename", "")))))
    names = {link.get("name") for link in robot.iterfind("link")}
    named = [(j, "name") for j in robot.iterfind("joint")] + [(m, "joint") for m in robot.iter("mimic")]
    for element, key in named:
        if element.get(key) in names:  # pinocchio does not distinguish the two
            element.set(key, f"{element.get(key)}_joint")
    unstated = [joint.get("name") for joint in robot.iterfind("joint") if not _complete_limits(joint)]
    if unstated:
        log.warning("%s states no speed of %s: %s.", path, ", ".join(map(str, unstated)), _USUAL_SPEEDS)
    unreal = [link.get("name") for link in robot.iterfind("link") if not _possible_inertia(link)]
    if unreal:
        log.warning(
            "%s: no body has the <inertial> of %s; it is left out.", path, ", ".join(map(str, unreal))
        )
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


def _complete_limits(joint: ET.Element) -> bool:
    """Complete the limits of a joint that moves; whether its speed was stated. Many exporters write 0 for "not"."""
    kind = joint.get("type", "")
    if kind not in SLIDES:
        return True
    limit = joint.find("limit")
    stated = kind == "continuous" or numbers(limit, "velocity", (0.0,))[0] > 0
    limit = ET.SubElement(joint, "limit") if limit is None else limit
    for name, usual in (("velocity", SLIDING_SPEED if SLIDES[kind] else TURNING_SPEED), ("effort", EFFORT)):
        if not numbers(limit, name, (0.0,))[0] > 0:
            limit.set(name, str(usual))
    if kind == "continuous":
        joint.set("type", "revolute")
        limit.attrib.update(lower=str(-2 * np.pi), upper=str(2 * np.pi))
    return bool(stated)


def _possible_inertia(link: ET.Element) -> bool:
    """Whether a link's mass is not negative, and its inertia of some body; takes it out otherwise."""
    for inertial in link.findall("inertial"):
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        xx, yy, zz, xy, xz, yz = (numbers(inertia, f"i{axes}", (0.0,))[0] for axes in _AXES)
        low, *_, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if numbers(mass, "value", (0.0,))[0] < 0 or low < -1e-6 * abs(high):
            link.remove(inertial)
            return False
    return True


def find_mesh(urdf: Path, filename: str, link: str = "") -> Path:
    """The file of a mesh name in a URDF.

    It is absolute, relative to the URDF, or ``package://`` under one of the URDF's parents or of an installed package.
    """
    found = find_beside(urdf, filename)
    found = found or (_in_package(filename) if filename.startswith(PACKAGE) else None)
    if found is None:
        raise RobotError(
            f"The mesh {filename} of {f'link {link} in ' if link else ''}{urdf} does not exist. Looked for "
            f"{mesh_name(filename)} beside the file, in the folders above it and in installed packages: put it there, "
            "or fix the path."
        )
    return found


def without_looks(robot: ET.Element) -> str:
    """The text without visuals and materials, whose loading needs Vulkan."""
    bare = ET.fromstring(ET.tostring(robot))
    for parent, tag in ((p, tag) for p in [bare, *bare.findall("link")] for tag in ("material", "visual")):
        for child in parent.findall(tag):
            parent.remove(child)
    return ET.tostring(bare, encoding="unicode")


def _as_obj(source: Path) -> Path:
    """The triangles of a collision mesh in metres as an OBJ file in the cache; STL files stay as they are.

    Collision checkers and simulators disagree on units, nodes, axes and unused vertices; a plain OBJ file or an STL
    file, which have none of these, they read alike.
    """
    if source.suffix.lower() == ".stl" or source.is_relative_to(cache_folder()):
        return source
    with reading("the collision mesh", source, RobotError):
        files = [source, *source.parent.glob("*.bin")] if source.suffix.lower() == ".gltf" else [source]
        digest = hashlib.sha256(source.suffix.lower().encode())
        for file in files:
            digest.update(file.read_bytes())
        target = cache_folder() / "collision" / f"{digest.hexdigest()[:32]}.obj"
        if not target.is_file():
            mesh = read_mesh(source, up="z")
            target.parent.mkdir(parents=True, exist_ok=True)
            write_mesh(target, TriangleMesh(mesh.vertices, mesh.faces))
    return target


@lru_cache
def _in_package(name: str) -> Path | None:
    """The file of ``package://PACKAGE/PATH``: in ROS's folders, an installed distribution or a Python package."""
    package, _, rest = name.removeprefix(PACKAGE).lstrip("/").partition("/")
    ros = {
        name: os.environ.get(name, "").split(os.pathsep) for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
    }
    folders = [Path(one) for one in ros["ROS_PACKAGE_PATH"] if one]
    folders += [Path(one) / "share" for one in ros["AMENT_PREFIX_PATH"] if one]  # of ROS 2
    for folder in folders:
        for root in (folder, folder / package):
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
    places = (spec.submodule_search_locations if spec else None) or []
    return next((Path(f) / rest for f in places if (Path(f) / rest).is_file()), None)
