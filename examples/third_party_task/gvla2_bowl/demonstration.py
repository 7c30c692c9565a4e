"""The task done by hand, from true state: proof that it can be done. No planner sees it."""

import numpy as np

from gvla2.geometry.transform import rigid
from gvla2.planning.trajectory import Orientation, Waypoint, grasp_rotation

DOWN = (0.0, 0.0, -1.0)
UP = np.array([0.0, 0.0, 1.0])
LIFT = 0.2


def put_in(ball, bowl, rim):
    """Waypoints that take ``ball`` from above and let it go in ``bowl``, whose rim is ``rim`` metres high."""

    def solve(world, arm):
        start = world.pose(ball)[:3, 3]
        over = world.pose(bowl)[:3, 3] + UP * (rim + 0.02)
        turned = Orientation("grasp", DOWN, easiest(arm, [start, start + UP * LIFT, over, over + UP * LIFT]))
        touched = frozenset({ball, bowl, "table"})

        def stop(stage, xyz, gripper, motion="linear", carries=""):
            place = tuple(float(v) for v in xyz)
            return Waypoint(place, gripper, stage, turned, motion, 0.2, touched, carries)

        yield [
            stop("approach", start + UP * 0.1, 1.0, "free"),
            stop("reach", start, 1.0),
            stop("grasp", start, 0.0),
            stop("lift", start + UP * LIFT, 0.0, carries=ball),
            stop("carry", over + UP * (LIFT - 0.05), 0.0, "free", carries=ball),
            stop("lower", over, 0.0, carries=ball),
            stop("release", over, 1.0),
            stop("leave", over + UP * (LIFT - 0.05), 1.0),
        ]

    return solve


def easiest(arm, points):
    """The direction (3,) for the fingers to close along that keeps the joints furthest from their limits."""

    def margin(closing):
        rotation = grasp_rotation(np.array(DOWN), np.array(closing))
        found = [arm.inverse(rigid(rotation, point)) for point in points]
        return min(-1.0 if each is None else each.limit_margin for each in found)

    turns = np.pi * np.arange(8) / 8
    return max(((float(np.sin(t)), float(np.cos(t)), 0.0) for t in turns), key=margin)
