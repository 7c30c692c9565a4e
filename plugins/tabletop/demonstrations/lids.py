"""Hinged lids: swung open by the lip, pushed shut from behind."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gvla2.geometry.transform import rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.boxes import TRAVEL, LidBox, lip_path, shut_paths
from gvla2_plugins.tabletop.demonstrations.moves import best_path, through

LIP_REACH, STANDOFF = 0.006, 0.06
"""Of the tool centre point inside the lip's edge: the fingertips end before the box's wall; and before the grasp."""

OPENED, FALLS = 1.8, 1.0
"""How far the lid is swung open, and from which opening it falls shut by itself; radians."""

_BOX = ("box", "lid", "table")


def swing_open(box: LidBox) -> Solution:
    """Grasp the lip from the front, fingers above and below, and go round the hinge with it."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        paths = [lip_path(box, np.linspace(0.0, OPENED, 9), LIP_REACH, sign) for sign in (1.0, -1.0)]
        before = [path[0] @ rigid(translation=(0, 0, -STANDOFF)) for path in paths]
        best = best_path(arm, [[first, *path] for first, path in zip(before, paths, strict=True)])
        grasp, *swing = paths[best]
        yield [
            *through("approach", [before[best]], 0.6, free=True, contacts=_BOX),
            *through("reach", [grasp], 0.6, speed=0.1, contacts=_BOX),
            *through("grasp", [grasp], 0.0, contacts=_BOX),
            *through("swing", swing, 0.0, speed=0.12, contacts=_BOX, tolerance=0.02),
        ]

    return solve


def push_shut(box: LidBox) -> Solution:
    """Hook closed fingers behind the lid's edge and pull it over the hinge; it falls the rest of the way."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        angles = np.linspace(TRAVEL, FALLS, 9)
        paths = shut_paths(box, angles)
        above, behind, *push = paths[best_path(arm, paths)]
        yield [
            *through("approach", [above], 0.0, free=True, contacts=_BOX),
            *through("lower", [behind], 0.0, contacts=_BOX),
            *through("push", push, 0.0, contacts=_BOX, tolerance=0.02),
            *through("leave", [rigid(translation=(0, 0, 0.12)) @ push[-1]], 0.0, contacts=_BOX),
        ]

    return solve
