"""A robot cell: the simulation's data on an arm, its place, its table and its cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.task import Body, Primitive
from gvla2_plugins.sapien.cameras import Mounts
from gvla2_plugins.sapien.grippers import Gripper

TABLE_RGB = (0.76, 0.61, 0.43)
"""Wood; apart from all twenty colour words."""

TABLE_THICKNESS = 0.05


@dataclass(frozen=True)
class Workcell:
    """Everything specific to one simulated arm; metres, world frame.

    ``urdf`` is a text without visuals and materials, its meshes by absolute path. ``looks`` are the links' surfaces in
    their own frames, by name. ``hand_from_tcp`` (4, 4) is the tool centre point in the frame of the gripper's palm;
    closed fingers are ``gap`` apart. ``base_links`` don't move. Tasks are laid out in the rectangle ``site_size``
    (x, y) about ``site_centre``, on ``table``. ``either_way``: a place is in reach when the hand gets there with its
    fingers either way round, for a wrist that turns less than once, and with a manipulability of ``ease`` at least (a
    share of the arm's best). Pointing down it gets no farther than ``reach`` from the base's axis.
    """

    robot: str
    arm: ArmModel
    urdf: str
    looks: Mapping[str, Surface]
    world_from_base: FloatArray
    base_links: frozenset[str]
    gripper: Gripper
    hand_from_tcp: FloatArray
    gap: float
    table: Body
    site_centre: tuple[float, float]
    site_size: tuple[float, float]
    mounts: Mounts
    either_way: bool
    ease: float
    reach: float

    @property
    def table_height(self) -> float:
        """Of the table's top."""
        return float(self.table.world_from_body[2, 3]) + 0.5 * self.table.solids[0].size[2]


def table_of(size: tuple[float, float], centre: tuple[float, float], height: float) -> Body:
    """A wooden table top: sides ``size`` (x, y), its upper side at ``height``."""
    top = Primitive("box", (*size, TABLE_THICKNESS), TABLE_RGB)
    return Body("table", (top,), rigid(translation=(*centre, height - 0.5 * TABLE_THICKNESS)), fixed=True)
