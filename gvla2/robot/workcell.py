"""A simulated arm at a table: where tasks are laid out, and its cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, look_along, rigid
from gvla2.robot.arm_from_urdf import AHEAD, RobotModel, arm_from_urdf
from gvla2.robot.options import WorkcellConfig
from gvla2.robot.task import Body, Primitive

CAMERAS = {
    "front": (1.1, 0.0, 0.828, -0.906, 0.0, -0.423),
    "left_shoulder": (-0.425, 0.2, 1.228, 0.416, -0.073, -0.906),
    "right_shoulder": (-0.425, -0.2, 1.228, 0.416, 0.073, -0.906),
}
"""Position, from the site's centre on the table's top, and viewing direction; metres."""

WRIST, TCP_FROM_WRIST = "wrist", look_along((-0.07, 0.0, -0.085), (0.12, 0.0, 1.0), up=(-1.0, 0.0, 0.0))
"""The wrist's camera is on the far side of the hand, looking past the fingers."""

FOV, WRIST_FOV = float(np.deg2rad(40.0)), float(np.deg2rad(60.0))

SEEN = (0.65, 0.91)
"""Size of the table, metres, about the cameras' field of view: an automatic site is never larger."""

TABLE_RGB, TABLE_THICKNESS = (0.76, 0.61, 0.43), 0.05
"""Wood, apart from all twenty colour words; metres."""


@dataclass(frozen=True)
class Workcell(RobotModel):
    """Everything specific to one simulated arm; metres, world frame.

    Tasks are laid out in the rectangle ``site_size`` (x, y) about ``site_centre``, on ``table``. The hand reaches
    places up to ``reach`` from the base's axis. ``fixed`` are the fixed cameras' positions and viewing directions (six
    numbers) by name; the camera ``wrist`` is on the hand.
    """

    table: Body
    site_centre: tuple[float, float]
    site_size: tuple[float, float]
    fixed: Mapping[str, Sequence[float]]
    reach: float

    @property
    def table_height(self) -> float:
        """Of the table's top."""
        return float(self.table.world_from_body[2, 3]) + 0.5 * self.table.solids[0].size[2]

    def check_cameras(self, names: Sequence[str]) -> None:
        """Raises :class:`ConfigurationError` for an unknown camera, one named twice, or none at all."""
        there = (*self.fixed, WRIST)
        if not names or not set(names) <= set(there) or len(set(names)) != len(names):
            raise ConfigurationError(
                f"robot.cameras={list(names)} must be one or more different names out of {', '.join(there)}."
            )

    def camera(self, name: str, size: int, world_from_tcp: FloatArray) -> Camera:
        """The camera of that name with square images of ``size`` pixels; the wrist's moves with the tool."""
        if name == WRIST:
            return Camera.from_fov(WRIST_FOV, world_from_tcp @ TCP_FROM_WRIST, size, size, name)
        pose = look_along(self.fixed[name][:3], self.fixed[name][3:])
        return Camera.from_fov(FOV, pose, size, size, name)


def make_cell(config: WorkcellConfig) -> Workcell:
    """The simulation of the arm that the options describe; raises as :func:`arm_from_urdf` does."""
    bad = [name for name, pose in config.camera_poses.items() if len(pose) != 6]
    if bad:
        raise ConfigurationError(
            f"robot.camera_poses needs six numbers for each camera, unlike {', '.join(bad)}."
        )
    made, height = arm_from_urdf(config), config.table_height
    reach, (x, y, _) = made.arm.ik.reach, config.base_position
    centre = config.site_centre or (x + AHEAD * reach, y)
    size = config.site_size or (min(0.6 * reach, SEEN[0]), min(0.75 * reach, SEEN[1]))
    fixed = config.camera_poses or {
        name: [p[0] + centre[0], p[1] + centre[1], p[2] + height, *p[3:]] for name, p in CAMERAS.items()
    }
    top = Primitive("box", (config.table_size[0], config.table_size[1], TABLE_THICKNESS), TABLE_RGB)
    at = (*(config.table_centre or centre), height - 0.5 * TABLE_THICKNESS)
    return Workcell(
        **{name: getattr(made, name) for name in RobotModel.__dataclass_fields__},
        table=Body("table", (top,), rigid(translation=at), fixed=True),
        site_centre=(centre[0], centre[1]),
        site_size=(size[0], size[1]),
        fixed=fixed,
        reach=config.reach or np.inf,
    )
