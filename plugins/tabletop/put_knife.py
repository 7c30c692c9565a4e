"""Draw a knife from its block and lay it on a chopping board."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.placing import at, clear
from gvla2.robot.solids import on
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import (
    DOWN,
    UP,
    Draw,
    Rgb,
    TabletopTask,
    around,
    box,
    lifted,
    raised,
    scaled,
)

BLOCK, TILT = (0.041, 0.08, 0.155), np.deg2rad(5.0)
SLOT = (0.027, 0.006, 0.125)
GRIP, BLADE = (0.023, 0.015, 0.084), (0.020, 0.002, 0.110)
MASS = 0.06
BOARD = (0.408, 0.26, 0.015)
SPAWN = (0.50, 0.25)
VOLUME = (0.25, 0.20, 0.02)
"""Metres, kilograms: depth, width, height. The block leans to its +x; the slot is open above. The board is about the
root; blocks stand in the spawning area about a point beside it."""

SPAWN_AT = (0.0, 0.30)
BLOCK_RGB, STEEL, BOARD_RGB = (0.35, 0.20, 0.10), (0.80, 0.82, 0.85), (0.95, 0.93, 0.88)


class PutKnife(TabletopTask[ScaledConfig]):
    """Lay the knife on the board. relaxed: some part of it is within 2 cm over the board's middle, let go of. strict:
    and it lies still.
    """

    name = "put_knife"
    instructions = (
        "put the knife on the chopping board",
        "take the {colour} knife out of the block and lay it on the board",
        "pull the knife from the knife block and place it on the cutting board",
        "move the knife with the {colour} handle onto the chopping board",
        "lay the knife down on the chopping board",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A knife in its block, and a board."""
        k = self.scale
        root, stand = draw.until(lambda: self._poses(draw), "a knife block and a board")
        (colour,) = draw.colours(1, beside=(BLOCK_RGB, STEEL, BOARD_RGB))
        board = box(BOARD, BOARD_RGB, (0, 0, BOARD[2] / 2))
        knife = Body(
            "knife", _knife(k, COLOURS[colour]), _in_slot(stand, k), MASS, label=f"{colour} knife",
            shape="other", parts=(("handle", (0,)),),
        )  # fmt: skip
        bodies = (
            Body("board", (board,), root, fixed=True, label="white chopping board", shape="plate"),
            Body("block", _block(k), stand, fixed=True, label="brown knife block", shape="box"),
            knife,
        )
        volume = on(at(root, 0.0, 0.0, BOARD[2]), VOLUME[:2], VOLUME[2])

        def relaxed(world: WorldState) -> bool:
            return volume.meets(knife, world.pose("knife")) and "robot" not in world.touching("knife")

        return draw.instance(
            Layout(bodies),
            relaxed,
            lambda world: relaxed(world) and world.resting("knife"),
            "relaxed: the knife is on the middle of the board, let go of; strict: and lies still",
            colour=colour,
        )

    def _poses(self, draw: Draw) -> tuple[FloatArray, FloatArray] | None:
        """Poses (4, 4) of the board's and of the leaning block's underside."""
        root, k = draw.root(), self.scale
        x, y = np.asarray(SPAWN_AT) + draw.rng.uniform(-0.5, 0.5, size=2) * SPAWN
        foot = at(root, x, y, 0.0, draw.angle())
        spots = np.stack([root[:2, 3], foot[:2, 3]])
        if not clear(spots, (BOARD[1] / 2, k * BLOCK[1]), 0.02) or not draw.inside(foot[:2, 3], k * 0.05):
            return None
        beside = np.abs(np.linalg.inv(root) @ foot[:, 3])[:2]
        if (beside < np.array(BOARD[:2]) / 2 + k * 0.05).all() or not draw.inside(root[:2, 3], BOARD[1] / 2):
            return None
        # The lower edge of the leaning block is on the table.
        lean = rigid(Rotation.from_euler("y", TILT).as_matrix(), (0, 0, k * BLOCK[0] / 2 * np.sin(TILT)))
        stand, follows = foot @ lean, draw.site.follows
        paths = knife_paths(_in_slot(stand, k), root, k)
        feasible = any(follows(out) and any(map(follows, lays)) for out, lays in paths)
        return (root, stand) if feasible else None


def _in_slot(stand: FloatArray, k: float) -> FloatArray:
    """world_from_knife (4, 4): its grip stands on the block's top, its blade in the slot."""
    return stand @ lifted(k * (BLOCK[2] + GRIP[2] / 2) + 0.0005)


def _knife(k: float, rgb: Rgb) -> tuple[Primitive, ...]:
    """Grip about the origin, blade below it along -z."""
    below = -k * (GRIP[2] + BLADE[2]) / 2
    return box(scaled(k, GRIP), rgb), box(scaled(k, BLADE), STEEL, (0.0, 0.0, below))


def _block(k: float) -> tuple[Primitive, ...]:
    """A block that stands on z = 0 with a slot from above, out of its floor and four walls."""
    (x, y, z), (deep, wide, down) = scaled(k, BLOCK), scaled(k, SLOT)
    cheek, end, middle = (y - wide) / 2, (x - deep) / 2, z - down / 2
    walls = (
        ((x, y, z - down), (0.0, 0.0, (z - down) / 2)),
        ((x, cheek, down), (0.0, (wide + cheek) / 2, middle)),
        ((x, cheek, down), (0.0, -(wide + cheek) / 2, middle)),
        ((end, wide, down), ((deep + end) / 2, 0.0, middle)),
        ((end, wide, down), (-(deep + end) / 2, 0.0, middle)),
    )
    return tuple(box(size, BLOCK_RGB, place) for size, place in walls)


STANDOFF, ABOVE, ON_GRIP = 0.07, 0.10, 0.010
"""Metres: before the grip, over the board; how far above the grip's middle the hand takes it."""

Paths = list[tuple[list[FloatArray], list[list[FloatArray]]]]


def knife_paths(knife: FloatArray, board: FloatArray, scale: float) -> Paths:
    """Ways to do it: tool poses (4, 4) out of the block, each with eight ways down to the board.

    The hand comes from either side of the grip, flat, and lays the knife along any of eight directions.
    """
    ways: Paths = []
    axis, middle = knife[:3, 2], knife[:3, 3] + scale * ON_GRIP * knife[:3, 2]
    height = BOARD[2] + scale * GRIP[0] / 2 + 0.003
    for approach in (knife[:3, 0], -knife[:3, 0]):
        for sign in (1.0, -1.0):
            turned = grasp_rotation(approach, sign * knife[:3, 1])
            drawn = middle + axis * (scale * BLADE[2] + 0.03)
            out = [rigid(turned, spot) for spot in (middle - STANDOFF * approach, middle, drawn)]
            # The blade lies along -axis in the hand: about the hand's x, one way or the other.
            along_x = (turned.T @ -axis)[0] > 0
            lays = []
            for along in around(UP, board[:3, 0], 8):
                # Pointing down, the hand is turned so that the blade points `along`.
                spot = board[:3, 3] - along * scale * BLADE[2] / 3 + UP * height
                down = rigid(_pointing_down(along, along_x), spot)
                lays.append([raised(down, ABOVE), down])
            ways.append((out, lays))
    return ways


def _pointing_down(blade: FloatArray, along_x: bool) -> FloatArray:
    """(3, 3) of a hand that points down and whose x axis is ``blade``, or its opposite."""
    x = blade if along_x else -blade
    return np.asarray(grasp_rotation(DOWN, np.cross(DOWN, x)))
