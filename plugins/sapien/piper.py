"""AgileX's Piper in simulation: on a block at a table, its fingertips' reach in the middle of the picture.

With its base on the table the wrist's 70 degrees would let the hand point down only up to 0.1 m above it; on the
block it does so from 0.1 to 0.4 m before the base, and up to 0.3 m high.
"""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import look_along, rigid
from gvla2.planning.scene import Box
from gvla2.robot.dh import FINGERS
from gvla2.robot.piper_arm import TCP_OFFSET, finger_joints, make_arm, piper_description
from gvla2.robot.task import Body
from gvla2_plugins.sapien.cameras import Mounts
from gvla2_plugins.sapien.cell import Cell, table_of
from gvla2_plugins.sapien.description import without_looks
from gvla2_plugins.sapien.looks import body_surface

STAND = 0.25
"""Height of the block under the base, which stands at the world's origin; metres."""

TABLE_HEIGHT, TABLE_SIZE, TABLE_CENTRE = 0.0, (1.5, 1.6), (0.45, 0.0)
SITE_CENTRE, SITE_SIZE = (0.57, 0.0), (0.74, 0.84)
"""Where tasks are laid out, metres: beyond what the hand reaches from above, for furniture pulled from its front."""

REACH = 0.50
"""No hand points down at the table farther from the base's axis than this, metres."""

EASE = 0.06
"""Twice the manipulability at which a plan is refused: where tasks are laid out there is room to work."""

WORKSPACE = ((0.05, -0.50, 0.0), (0.95, 0.50, 0.65))
"""Low and high corner of where the tool may go, metres, world."""

MOUNTS = Mounts(
    {
        "front": ((1.35, 0.0, 0.75), (-0.81, 0.0, -0.586)),
        "left_shoulder": ((-0.05, 0.40, 1.10), (0.344, -0.32, -0.883)),
        "right_shoulder": ((-0.05, -0.40, 1.10), (0.344, 0.32, -0.883)),
    },
    look_along((-0.07, 0.0, -0.085), (0.12, 0.0, 1.0), up=(-1.0, 0.0, 0.0)),
)


def piper_cell() -> Cell:
    """The Piper's simulation."""
    description = piper_description(stand=STAND)
    world_from_base = rigid(translation=(0.0, 0.0, STAND))
    workspace = Box(np.array(WORKSPACE[0]), np.array(WORKSPACE[1]))
    left, right = finger_joints()
    return Cell(
        robot="sapien_piper",
        arm=make_arm(world_from_base, workspace, limit_margin=0.01, stand=STAND),
        urdf=without_looks(description.urdf()),
        srdf=description.srdf(),
        looks={
            link: body_surface(Body(link, solids, np.eye(4))) for link, solids in description.solids.items()
        },
        world_from_base=world_from_base,
        hand_link=description.last_link,
        finger_links=FINGERS,
        fingers=(left, right),
        tcp_offset=TCP_OFFSET,
        table=table_of(TABLE_SIZE, TABLE_CENTRE, TABLE_HEIGHT),
        site_centre=SITE_CENTRE,
        site_size=SITE_SIZE,
        mounts=MOUNTS,
        either_way=True,
        ease=EASE,
        reach=REACH,
    )
