"""The Panda's description as SAPIEN can load it without a renderer."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from gvla2_plugins.sapien_panda.looks import find_mesh
from gvla2_plugins.sapien_panda.panda import PandaFiles

FINGER_LINKS = ("panda_leftfinger", "panda_rightfinger")

PATCH_RADIUS = 0.1
"""Of the fingers' contact patches, metres: gives a point contact the resistance to turning of a soft pad."""


def load_panda(scene: Any, files: PandaFiles, friction: float) -> Any:
    """The Panda as an articulation in ``scene``, base fixed, fingers coupled and rough (``friction``).

    Visuals and materials are taken out of the URDF first: loading them needs Vulkan.
    """
    tree = ET.parse(files.urdf)
    root = tree.getroot()
    for material in root.findall("material"):
        root.remove(material)
    for link in root.iterfind("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(find_mesh(files.urdf, mesh.get("filename", ""))))
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    for finger in FINGER_LINKS:
        loader.set_link_material(finger, friction, friction, 0.0)
        loader.set_link_patch_radius(finger, PATCH_RADIUS)
        loader.set_link_min_patch_radius(finger, PATCH_RADIUS)
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / "panda.urdf"
        tree.write(bare)
        bare.with_suffix(".srdf").write_text(files.srdf.read_text())
        panda = loader.load(str(bare))
    for link in panda.links:
        link.disable_gravity = True  # a real Panda's controller carries its own weight, too
    return panda
