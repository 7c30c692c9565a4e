"""A brick out of its tower: held by the end that sticks out, drawn straight, set down aside."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import DOWN, best_path, through

FROM_END = 0.02
"""Of the grasp from the brick's end, metres: the palm stays clear of the tower."""

DRAWN, ASIDE, CLEAR = 0.20, (0.225, 0.2), 0.06
_LENGTH, _HEIGHT = 0.18, 0.0297


def brick_path(root: FloatArray, brick: FloatArray, scale: float) -> FloatArray:
    """(6, 4, 4) tool poses: above the brick's end, at it, drawn out, aside, set down, above again.

    ``brick`` (4, 4), its x axis pointing out of the tower.
    """
    out, across = brick[:3, 0], root[:3, 0]
    turned = grasp_rotation(DOWN, brick[:3, 1])
    grasp = brick[:3, 3] + out * (scale * _LENGTH / 2 - FROM_END)
    drawn = grasp + out * scale * DRAWN
    # The brick's middle comes over the goal.
    goal = root[:3, 3] + root[:3, :2] @ np.asarray(ASIDE)
    aside = drawn + across * float((goal - drawn) @ across)
    down = goal + (grasp - brick[:3, 3])
    down[2] = root[2, 3] + scale * _HEIGHT / 2 + 0.003
    points = [grasp - CLEAR * DOWN, grasp, drawn, aside, down, down - CLEAR * DOWN]
    return np.stack([rigid(turned, point) for point in points])


def pull_brick(path: Callable[[FloatArray], FloatArray]) -> Solution:
    """Pull the body ``loose`` along the tool path that ``path`` gives for its pose."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        poses = path(world.pose("loose"))
        ways = [list(poses @ rigid(np.diag([sign, sign, 1.0]))) for sign in (1.0, -1.0)]
        above, grasp, drawn, aside, down, away = ways[best_path(arm, ways)]
        near = ["loose", "table", *(f"brick_{layer}_{slot}" for layer in range(5) for slot in range(3))]
        yield [
            *through("approach", [above], 0.95, free=True, contacts=near),
            *through("reach", [grasp], 0.95, contacts=near, speed=0.1),
            *through("grasp", [grasp], 0.0, contacts=near),
            *through("pull", [drawn, aside, down], 0.0, contacts=near, carries="loose"),
            *through("release", [down], 1.0, contacts=near),
            *through("leave", [away], 1.0, contacts=near),
        ]

    return solve
