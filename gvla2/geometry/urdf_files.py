"""URDF files as others write them: parsed and checked once, for robots and for objects with joints."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError, reading
from gvla2.geometry.transform import FloatArray, rigid

SLIDES = {"prismatic": True, "revolute": False, "continuous": False}
"""Types of joints that move about or along one axis, and whether they slide."""

_TYPES = {*SLIDES, "fixed", "floating", "planar"}
_COUNTS = {
    ("origin", "xyz"): (3,), ("origin", "rpy"): (3,), ("axis", "xyz"): (3,), ("mesh", "scale"): (3,),
    ("box", "size"): (3,), ("cylinder", "radius"): (1,), ("cylinder", "length"): (1,), ("sphere", "radius"): (1,),
    ("color", "rgba"): (3, 4), ("mimic", "multiplier"): (1,), ("mimic", "offset"): (1,), ("mass", "value"): (1,),
    **{("limit", name): (1,) for name in ("lower", "upper", "velocity", "effort")},
    **{("inertia", f"i{axes}"): (1,) for axes in ("xx", "xy", "xz", "yy", "yz", "zz")},
}  # fmt: skip
"""How many numbers an element's attribute has."""
_NEEDED = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ("filename",)}


def parse_urdf(path: str | os.PathLike[str]) -> ET.Element:
    """The ``robot`` element of a URDF whose links and joints form one tree and whose numbers are numbers.

    Prefixes that the file does not declare are declared, and attributes without a value are left out. Raises
    :class:`GeometryError` with the file, the link or joint, and what is wrong with it.
    """
    source = Path(path)
    with reading("a URDF", source):
        robot = _parsed(source.read_bytes())
        if any("xacro" in str(element.tag) for element in robot.iter()):
            raise GeometryError(
                "it has xacro in it; `xacro FILE.xacro > FILE.urdf` makes a plain URDF of it."
            )
        if robot.tag != "robot":
            raise GeometryError(f"its root is <{robot.tag}>, not <robot>; a URDF is needed.")
        for part in robot:
            if part.tag in ("link", "joint", "material"):
                _check_numbers(part)
        _check_tree(robot)
    return robot


def _parsed(content: bytes) -> ET.Element:
    try:
        return ET.fromstring(content)
    except ET.ParseError as error:
        if "unbound prefix" not in str(error):
            raise
    prefixes = sorted(
        {*re.findall(rb"<(\w+):", content), *re.findall(rb"\s(\w+):\w+\s*=", content)} - {b"xmlns"}
    )
    missing = b"".join(
        b' xmlns:%b="%b"' % (prefix, prefix) for prefix in prefixes if b"xmlns:" + prefix not in content
    )
    return ET.fromstring(re.sub(rb"<robot\b", lambda match: match[0] + missing, content, count=1))


def _check_numbers(part: ET.Element) -> None:
    """Raise :class:`GeometryError` for a number of a link, joint or material that is none; drop empty attributes."""
    owner = f"{part.tag} '{part.get('name')}'"
    for element in part.iter():
        for name, given in list(element.attrib.items()):
            counts = _COUNTS.get((element.tag, name))
            if counts is not None and not given.strip():
                del element.attrib[name]
            elif counts is not None:
                _count(given, counts, f'<{element.tag} {name}="{given}"> of {owner}')
        for name in _NEEDED.get(element.tag, ()):
            if not element.get(name):
                raise GeometryError(f"the <{element.tag}> of {owner} has no {name}.")


def _count(given: str, counts: Sequence[int], where: str) -> None:
    try:
        numbers = [float(word) for word in given.split()]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not np.isfinite(numbers).all():
        hint = "; xacro expands such an expression" if "$" in given else ""
        wanted = "1 finite number" if counts[-1] == 1 else f"{counts[-1]} finite numbers, separated by spaces"
        raise GeometryError(f"{where} needs {wanted}{hint}.")


def _check_tree(robot: ET.Element) -> None:
    """Raise :class:`GeometryError` unless all links hang on one root by joints of known types."""
    links, joints = robot.findall("link"), robot.findall("joint")
    for kind, elements in (("link", links), ("joint", joints)):
        names = Counter(element.get("name") or "" for element in elements)
        if "" in names:
            raise GeometryError(f"a <{kind}> has no name.")
        if twice := [name for name, number in names.items() if number > 1]:
            raise GeometryError(f"it has two {kind}s called '{twice[0]}'.")
    parents: dict[str, str] = {}
    known = {link.get("name", "") for link in links}
    for joint in joints:
        name, kind = joint.get("name"), joint.get("type", "")
        if kind not in _TYPES:
            raise GeometryError(
                f"joint '{name}' has the type '{kind}'; a URDF has {', '.join(sorted(_TYPES))}."
            )
        ends = {end: link_of(joint, end) for end in ("parent", "child")}
        for end, link in ends.items():
            if link not in known:
                what = f"its {end} link '{link}' does not exist" if link else f"it has no {end} link"
                raise GeometryError(f"joint '{name}': {what}.")
        if ends["child"] in parents:
            raise GeometryError(f"two joints carry link '{ends['child']}'; a link hangs on one.")
        parents[ends["child"]] = ends["parent"]
        if kind in ("revolute", "prismatic") and joint.find("limit") is None:
            raise GeometryError(f"joint '{name}' ({kind}) has no <limit lower=... upper=...>.")
        axis = joint.find("axis")
        if kind in SLIDES and axis is not None and not any(numbers(axis, "xyz", (1, 0, 0))):
            raise GeometryError(f"the axis of joint '{name}' is 0.")
    for link in parents:
        above = link
        for _ in links:
            above = parents.get(above, "")
        if above:
            raise GeometryError(f"the joints of link '{link}' form a circle.")
    roots = [link.get("name", "") for link in links if link.get("name") not in parents]
    if len(roots) != 1:
        what = f"several roots, {', '.join(roots)}: join them by fixed joints" if roots else "no links"
        raise GeometryError(f"it has {what}.")


def link_of(joint: ET.Element, end: str) -> str:
    """The name of a joint's ``parent`` or ``child`` link, "" if it has none."""
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def numbers(element: ET.Element | None, name: str, usual: Sequence[float] | FloatArray) -> FloatArray:
    """The numbers of an attribute in a parsed URDF; ``usual`` where it is absent."""
    given = None if element is None else element.get(name)
    return np.array(given.split() if given else usual, dtype=np.float64)


def origin_of(element: ET.Element) -> FloatArray:
    """(4, 4) of the ``origin`` of a visual, a collision or a joint."""
    shift, turn = (numbers(element.find("origin"), name, (0.0, 0.0, 0.0)) for name in ("xyz", "rpy"))
    return rigid(Rotation.from_euler("xyz", turn).as_matrix(), shift)


def paint_of(visual: ET.Element, robot: ET.Element) -> FloatArray | None:
    """The colour (3,) in [0, 1] of a visual's own material, or of the robot's one of its name; None without."""
    material = visual.find("material")
    if material is None:
        return None
    named = (each for each in robot.iterfind("material") if each.get("name") == material.get("name"))
    paints = (each.find("color") for each in (material, *named))
    found = next((paint for paint in paints if paint is not None and paint.get("rgba")), None)
    return None if found is None else np.clip(numbers(found, "rgba", ())[:3], 0.0, 1.0)


def mesh_name(filename: str) -> str:
    """A mesh's name in a URDF without its scheme, with slashes and spaces as in a path."""
    scheme, mark, rest = filename.partition("://")
    if mark and scheme == "file":
        rest = unquote(rest)
    elif mark:
        rest = rest.lstrip("/")
    return (rest if mark else filename).replace("\\", "/")


def find_beside(urdf: Path, filename: str) -> Path | None:
    """The file of a mesh name: absolute, or relative to the URDF or to one of the folders above it."""
    name = mesh_name(filename)
    return next((each / name for each in urdf.absolute().parents if name and (each / name).is_file()), None)
