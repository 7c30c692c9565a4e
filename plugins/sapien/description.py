"""A robot's description in the form that SAPIEN loads without a renderer."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from gvla2.robot.workcell import Workcell

PATCH_RADIUS = 0.1
"""Of the fingers' contact patches, metres: gives a point contact the resistance to turning of a soft pad."""


def load_robot(scene: Any, cell: Workcell, friction: float) -> Any:
    """The cell's arm as an articulation in ``scene``, base fixed, fingers coupled and rough (``friction``)."""
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    for finger in cell.gripper.finger_links:
        loader.set_link_material(finger, friction, friction, 0.0)
        loader.set_link_patch_radius(finger, PATCH_RADIUS)
        loader.set_link_min_patch_radius(finger, PATCH_RADIUS)
    close = sorted(sorted(pair) for pair in cell.arm.collisions.overlapping if len(pair) == 2)
    off = (f'<disable_collisions link1="{a}" link2="{b}" reason="Default"/>' for a, b in close)
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / "robot.urdf"
        bare.write_text(cell.urdf)
        bare.with_suffix(".srdf").write_text(f"<robot>{''.join(off)}</robot>")
        robot = loader.load(str(bare))
    for link in robot.links:
        link.disable_gravity = True  # a real arm's controller compensates gravity too
    return robot
