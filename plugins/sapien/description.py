"""A robot's description as SAPIEN can load it without a renderer."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from gvla2_plugins.sapien.cell import Cell
from gvla2_plugins.sapien.looks import find_mesh

PATCH_RADIUS = 0.1
"""Of the fingers' contact patches, metres: gives a point contact the resistance to turning of a soft pad."""


def without_looks(text: str, urdf: Path | None = None) -> str:
    """A URDF's text without visuals and materials, whose loading needs Vulkan.

    Meshes get their full paths, from where the file ``urdf`` lies.
    """
    root = ET.fromstring(text)
    for material in root.findall("material"):
        root.remove(material)
    for link in root.iterfind("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    for mesh in root.iter("mesh") if urdf is not None else ():
        mesh.set("filename", str(find_mesh(urdf, mesh.get("filename", ""))))
    return ET.tostring(root, encoding="unicode")


def load_robot(scene: Any, cell: Cell, friction: float) -> Any:
    """The cell's arm as an articulation in ``scene``, base fixed, fingers coupled and rough (``friction``)."""
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    for finger in cell.finger_links:
        loader.set_link_material(finger, friction, friction, 0.0)
        loader.set_link_patch_radius(finger, PATCH_RADIUS)
        loader.set_link_min_patch_radius(finger, PATCH_RADIUS)
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / "robot.urdf"
        bare.write_text(cell.urdf)
        bare.with_suffix(".srdf").write_text(cell.srdf)
        robot = loader.load(str(bare))
    for link in robot.links:
        link.disable_gravity = True  # a real arm's controller carries its own weight, too
    return robot
