"""A simulated arm at a table: where tasks are laid out, and its cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, look_along, rigid
from gvla2.robot.arm_from_urdf import STEP, UrdfArm, arm_from_urdf, check_lengths, pointing_down
from gvla2.robot.options import WorkcellConfig
from gvla2.robot.task import Body, Primitive

CAMERAS = {
    "front": (1.1, 0.0, 0.828, -0.906, 0.0, -0.423),
    "left_shoulder": (-0.425, 0.2, 1.228, 0.416, -0.073, -0.906),
    "right_shoulder": (-0.425, -0.2, 1.228, 0.416, 0.073, -0.906),
}
"""Position, from the site's centre on the table's top, and viewing direction; metres."""

TCP_FROM_WRIST = look_along((-0.07, 0.0, -0.085), (0.12, 0.0, 1.0), up=(-1.0, 0.0, 0.0))
"""The wrist's camera is on the far side of the hand, looking past the fingers."""

SEEN = (0.65, 0.91)
"""Size of the table, metres, about the cameras' field of view: an automatic site is never larger."""

LENGTHS = {"table_size": 2, "table_centre": 2, "site_centre": 2, "site_size": 2}
OPTIONAL = ("table_centre", "site_centre", "site_size")


_WRIST = "wrist"
_FOV, _WRIST_FOV = np.deg2rad(40.0), np.deg2rad(60.0)


@dataclass(frozen=True)
class Mounts:
    """Where a cell's cameras are.

    ``fixed``: position and viewing direction in the world, metres, by name. ``tcp_from_wrist`` (4, 4) is the
    camera ``wrist`` on the hand.
    """

    fixed: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]]
    tcp_from_wrist: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """All cameras there are."""
        return (*self.fixed, _WRIST)

    def check(self, names: Sequence[str]) -> None:
        """Raises :class:`ConfigurationError` for an unknown camera, one named twice, or none at all."""
        unknown = [name for name in names if name not in self.names]
        if unknown or not names or len(set(names)) != len(names):
            raise ConfigurationError(
                f"robot.cameras={list(names)} must be one or more different names out of {', '.join(self.names)}."
            )

    def camera(self, name: str, size: int, world_from_tcp: FloatArray) -> Camera:
        """The camera of that name with square images of ``size`` pixels; the wrist's moves with the tool."""
        if name == _WRIST:
            return Camera.from_fov(float(_WRIST_FOV), world_from_tcp @ self.tcp_from_wrist, size, size, name)
        position, forward = self.fixed[name]
        return Camera.from_fov(float(_FOV), look_along(position, forward), size, size, name)


TABLE_RGB = (0.76, 0.61, 0.43)
"""Wood; apart from all twenty colour words."""

TABLE_THICKNESS = 0.05


@dataclass(frozen=True)
class Workcell(UrdfArm):
    """Everything specific to one simulated arm; metres, world frame.

    Tasks are laid out in the rectangle ``site_size`` (x, y) about ``site_centre``, on ``table``. The hand reaches
    places up to ``reach`` from the base's axis, with a manipulability of at least ``ease`` (a share of the arm's best)
    and, if ``either_way``, with its fingers one way round.
    """

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


def make_cell(config: WorkcellConfig) -> Workcell:
    """The simulation of the arm that the options describe; raises as :func:`arm_from_urdf` does."""
    check_lengths(config, LENGTHS, OPTIONAL)
    bad = [name for name, pose in config.camera_poses.items() if len(pose) != 6]
    if bad:
        raise ConfigurationError(
            f"robot.camera_poses needs six numbers for each camera, unlike {', '.join(bad)}."
        )
    made = arm_from_urdf(config)
    centre, size, reach = _site(config, made)
    height = config.table_height
    fixed = config.camera_poses or {
        name: [p[0] + centre[0], p[1] + centre[1], p[2] + height, *p[3:]] for name, p in CAMERAS.items()
    }
    return Workcell(
        **{name: getattr(made, name) for name in UrdfArm.__dataclass_fields__},
        table=table_of(_pair(config.table_size), _pair(config.table_centre or centre), height),
        site_centre=centre,
        site_size=size,
        mounts=Mounts(
            {n: ((p[0], p[1], p[2]), (p[3], p[4], p[5])) for n, p in fixed.items()}, TCP_FROM_WRIST
        ),
        either_way=config.either_way,
        ease=config.ease,
        reach=reach,
    )


def _pair(sides: Sequence[float]) -> tuple[float, float]:
    return sides[0], sides[1]


def _site(config: WorkcellConfig, made: UrdfArm) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Where tasks are laid out: centre, sides; and how far from the base's axis the hand points down; metres."""
    x, y, _ = config.base_position
    reach = config.reach or np.inf
    if config.site_centre and config.site_size:
        return _pair(config.site_centre), _pair(config.site_size), reach
    run = pointing_down(config, made.arm)
    centre = config.site_centre or (x + 0.5 * (run[0] + run[-1]), y)
    size = config.site_size or (min(run[-1] - run[0], SEEN[0]), min(1.1 * run[-1], SEEN[1]))
    return _pair(centre), _pair(size), min(reach, run[-1] + STEP)
