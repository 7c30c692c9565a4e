"""Franka's Panda arm, from the description that the package ``example-robot-data`` brings."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np

from gvla2.errors import MissingDependencyError
from gvla2.geometry.transform import look_along, rigid
from gvla2.planning.arm import Hand
from gvla2.planning.scene import Box
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.kinematics import Finger
from gvla2_plugins.sapien.cameras import Mounts
from gvla2_plugins.sapien.cell import Cell, table_of
from gvla2_plugins.sapien.description import without_looks
from gvla2_plugins.sapien.looks import robot_surfaces

BASE_POSITION = (-0.268, -0.006, 0.750)
"""The base in the world, metres; its axes are the world's."""

TABLE_HEIGHT, TABLE_SIZE, TABLE_CENTRE = 0.752, (1.5, 1.8), (0.30, 0.0)
SITE_CENTRE, SITE_SIZE = (0.25, 0.0), (0.65, 0.91)
"""Where tasks are laid out, metres."""

MOUNTS = Mounts(
    {
        "front": ((1.35, 0.0, 1.58), (-0.906, 0.0, -0.423)),
        "left_shoulder": ((-0.175, 0.2, 1.98), (0.416, -0.073, -0.906)),
        "right_shoulder": ((-0.175, -0.2, 1.98), (0.416, 0.073, -0.906)),
    },
    look_along((-0.07, 0.0, -0.085), (0.12, 0.0, 1.0), up=(-1.0, 0.0, 0.0)),
)
"""The wrist's camera is on the far side of the hand, looking past the fingers."""

HOME = (0.0, 0.1745, 0.0, -0.8727, 0.0, 1.2217, 0.7854)
"""Resting joints, radians."""

WORKSPACE = ((-0.275, -0.655, 0.752), (0.775, 0.655, 1.752))
"""Low and high corner of where the tool may go, metres, world."""

HAND_FRAME = "panda_hand"
HAND_LINKS = ("panda_hand", "panda_leftfinger", "panda_rightfinger")
FINGERS = (Finger("panda_finger_joint1", 0.0, 0.04), Finger("panda_finger_joint2", 0.0, 0.04))

FINGERTIP_END = 0.1129
"""From the hand's frame to the end of the fingertips, metres, by the description's finger boxes."""

TCP_OFFSET = 0.1034
"""From the hand's frame to the middle of the fingertips' pads, metres, as the description's own TCP.

The home position (0.279, -0.009, 1.472) that the field's task suite publishes is of a point 20.9 mm further up
the hand (offset 0.0825), above the pads: a grasp centred there would hold nothing but the fingers' upper ends.
"""

PANDA_HAND = Hand(
    max_width=0.08,
    finger_length=FINGERTIP_END - 0.066,  # the palm ends 66 mm beyond the hand frame
    finger_thickness=0.0152,
    finger_breadth=0.022,
    tip_beyond_tcp=FINGERTIP_END - TCP_OFFSET,
    palm_breadth=0.204,
    palm_depth=0.063,
)


@dataclass(frozen=True)
class PandaFiles:
    """Where the description lies. ``package_dirs`` resolve its ``package://`` mesh names."""

    urdf: Path
    srdf: Path
    package_dirs: tuple[Path, ...]


def panda_files() -> PandaFiles:
    """The installed description; raises :class:`MissingDependencyError` when it is not installed."""
    try:
        files = distribution("example-robot-data").files or []
    except PackageNotFoundError:
        files = []
    urdf = next((f for f in files if f.parts[-2:] == ("urdf", "panda.urdf")), None)
    if urdf is None or not Path(str(urdf.locate())).is_file():
        raise MissingDependencyError(
            "example-robot-data", "The Panda arm's description", 'pip install "gvla2[sim]"', "Apache-2.0"
        )
    path = Path(str(urdf.locate())).resolve()
    folder = path.parents[1]
    return PandaFiles(path, folder / "srdf" / "panda.srdf", (folder.parents[2],))


def make_arm() -> ArmModel:
    """The Panda at its place in the world."""
    files = panda_files()
    return ArmModel.from_urdf(
        files.urdf,
        files.package_dirs,
        world_from_base=rigid(translation=BASE_POSITION),
        tcp_frame=HAND_FRAME,
        frame_from_tcp=rigid(translation=(0.0, 0.0, TCP_OFFSET)),
        hand=PANDA_HAND,
        home=HOME,
        workspace=Box(np.array(WORKSPACE[0]), np.array(WORKSPACE[1])),
        hand_links=HAND_LINKS,
        fingers=FINGERS,
        srdf=files.srdf,
    )


def panda_cell() -> Cell:
    """The Panda's simulation."""
    files = panda_files()
    left, right = HAND_LINKS[1:]
    return Cell(
        robot="sapien_panda",
        arm=make_arm(),
        urdf=without_looks(files.urdf.read_text(), files.urdf),
        srdf=files.srdf.read_text(),
        looks=robot_surfaces(files.urdf),
        world_from_base=rigid(translation=BASE_POSITION),
        hand_link=HAND_FRAME,
        finger_links=(left, right),
        fingers=FINGERS,
        tcp_offset=TCP_OFFSET,
        table=table_of(TABLE_SIZE, TABLE_CENTRE, TABLE_HEIGHT),
        site_centre=SITE_CENTRE,
        site_size=SITE_SIZE,
        mounts=MOUNTS,
    )
