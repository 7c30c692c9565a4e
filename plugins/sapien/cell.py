"""A robot cell: what the simulation needs to know of an arm, its place, its table and its cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.kinematics import Finger
from gvla2.robot.task import Body, Primitive
from gvla2_plugins.sapien.cameras import Mounts

TABLE_RGB = (0.76, 0.61, 0.43)
"""Wood; apart from all twenty colour words."""

TABLE_THICKNESS = 0.05


@dataclass(frozen=True)
class Cell:
    """Everything that differs from one simulated arm to the next; metres, world frame.

    ``urdf`` and ``srdf`` are texts: the URDF without visuals and materials, its meshes by absolute path. ``looks``
    are the links' surfaces in their own frames, by name. The tool centre point is ``tcp_offset`` along z of
    ``hand_link``, which the option ``attach`` ties things to; the two ``fingers`` move the ``finger_links``. Tasks
    are laid out in the rectangle ``site_size`` (x, y) about ``site_centre``, on ``table``. ``either_way``: a place is
    in reach when the hand gets there with its fingers either way round, for a wrist that turns less than once, and
    with a manipulability of ``ease`` at least (a share of the arm's best). Pointing down it gets no farther than
    ``reach`` from the base's axis.
    """

    robot: str
    arm: ArmModel
    urdf: str
    srdf: str
    looks: Mapping[str, Surface]
    world_from_base: FloatArray
    hand_link: str
    finger_links: tuple[str, str]
    fingers: tuple[Finger, Finger]
    tcp_offset: float
    table: Body
    site_centre: tuple[float, float]
    site_size: tuple[float, float]
    mounts: Mounts
    either_way: bool = False
    ease: float = 0.0
    reach: float = np.inf

    @property
    def table_height(self) -> float:
        """Of the table's top."""
        return float(self.table.world_from_body[2, 3]) + 0.5 * self.table.solids[0].size[2]


def table_of(size: tuple[float, float], centre: tuple[float, float], height: float) -> Body:
    """A wooden table top: sides ``size`` (x, y), its upper side at ``height``."""
    top = Primitive("box", (*size, TABLE_THICKNESS), TABLE_RGB)
    return Body("table", (top,), rigid(translation=(*centre, height - 0.5 * TABLE_THICKNESS)), fixed=True)
