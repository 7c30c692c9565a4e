"""Pull a drawer open by its handle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.placing import at
from gvla2.robot.solids import tray
from gvla2.robot.task import Body, Joint, Layout, TaskInstance
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import UP, Draw, TabletopTask, box, lifted, scaled

CABINET, BOARD = (0.24, 0.28, 0.16), 0.012
INNER_GAP = 0.004
TRAVEL, OPEN = 0.18, 0.10
BAR, BAR_LENGTH, BAR_OUT, BAR_HEIGHT = 0.012, 0.11, 0.040, 0.125
YAW = np.pi / 8
"""Metres. The cabinet's front looks to -x of its root; the bar of the handle runs across it, ``BAR_OUT`` before it."""

HANDLE_RGB = (0.25, 0.25, 0.27)

STANDOFF, PULL = 0.06, 0.15
LEANS = (0.0, 0.3, 0.6)
HAND_HALF, PALM_BACK, HAND_ROOM = 0.102, 0.06, 0.012
"""How far the hand may point down, radians; half of a broad hand's breadth, how far its palm is behind the fingertips
and what room it needs over the table, metres.
"""


class OpenDrawer(TabletopTask[ScaledConfig]):
    """Open the drawer. relaxed: it was pulled out by more than 10 cm at some time. strict: it still is."""

    name = "open_drawer"
    instructions = (
        "open the drawer",
        "pull the {colour} drawer open",
        "open the {colour} drawer by its handle",
        "slide the drawer out of the cabinet",
        "please pull the drawer open",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A cabinet with a drawer."""
        root = draw.until(lambda: self._root(draw), "a cabinet")
        colour, body_colour = draw.colours(2, beside=(HANDLE_RGB,))
        slide = Joint(
            "slide", "prismatic", "cabinet", "drawer", axis=-root[:3, 0], origin=root[:3, 3],
            limits=(0.0, TRAVEL), damping=8.0, friction=0.5,
        )  # fmt: skip
        return draw.instance(
            Layout((_cabinet(self.scale, root, body_colour), _drawer(self.scale, root, colour)), (slide,)),
            lambda world: world.peak("slide") > OPEN,
            lambda world: world.joint("slide") > OPEN,
            f"relaxed: the drawer was pulled out by more than {OPEN:g} m; strict: it still is",
            colour=colour,
        )

    def _root(self, draw: Draw) -> FloatArray | None:
        root, k = draw.root(YAW), self.scale
        x, y = k * CABINET[0] / 2, k * CABINET[1] / 2
        corners = [at(root, sx * x, sy * y)[:2, 3] for sx in (-1, 1) for sy in (-1, 1)]
        if not all(draw.inside(corner, 0.0) for corner in corners):
            return None
        return root if any(map(draw.site.follows, handle_paths(root, k))) else None


def _cabinet(k: float, root: FloatArray, colour: str) -> Body:
    """Floor, roof, sides and back, open to the front."""
    x, y, z = scaled(k, CABINET)
    boards = (
        ((x, y, BOARD), (0.0, 0.0, BOARD / 2)),
        ((x, y, BOARD), (0.0, 0.0, z - BOARD / 2)),
        ((x, BOARD, z - 2 * BOARD), (0.0, (y - BOARD) / 2, z / 2)),
        ((x, BOARD, z - 2 * BOARD), (0.0, (BOARD - y) / 2, z / 2)),
        ((BOARD, y - 2 * BOARD, z - 2 * BOARD), ((x - BOARD) / 2, 0.0, z / 2)),
    )
    carcass = tuple(box(size, COLOURS[colour], place) for size, place in boards)
    return Body("cabinet", carcass, root, 3.0, fixed=True, label=f"{colour} cabinet", shape="box")


def _drawer(k: float, root: FloatArray, colour: str) -> Body:
    """Front, tub, and a handle of a bar on two posts."""
    x, y, z = scaled(k, CABINET)
    depth, width, high = x - 2 * BOARD, y - 2 * BOARD - 2 * INNER_GAP, z - 2 * BOARD - 2 * INNER_GAP
    bottom, rgb = BOARD + INNER_GAP, COLOURS[colour]
    face = box((BOARD, width, high), rgb, ((BOARD - x) / 2, 0.0, bottom + high / 2))
    tub = [
        replace(side, body_from_shape=lifted(bottom) @ side.body_from_shape)
        for side in tray((depth, width, 0.7 * high), 0.006, rgb)
    ]
    out, length, height = k * BAR_OUT, k * BAR_LENGTH, k * BAR_HEIGHT
    bar = box((BAR, length, BAR), HANDLE_RGB, (-x / 2 - out, 0.0, height))
    posts = [
        box((out, BAR, BAR), HANDLE_RGB, (-(x + out) / 2, side * (length - BAR) / 2, height))
        for side in (1, -1)
    ]
    handle = ("handle", tuple(range(1 + len(tub), 4 + len(tub))))
    solids = (face, *tub, bar, *posts)
    return Body("drawer", solids, root, 0.6, label=f"{colour} drawer", shape="box", parts=(handle,))


def handle_paths(root: FloatArray, k: float) -> list[list[FloatArray]]:
    """Every :func:`handle_path` of the leans that leave the hand room, with the hand either way round."""
    lowest = [k * BAR_HEIGHT + PALM_BACK * np.sin(lean) - HAND_HALF * np.cos(lean) for lean in LEANS]
    leans = [lean for lean, low in zip(LEANS, lowest, strict=True) if low > HAND_ROOM]
    return [handle_path(root, k, sign, lean) for lean in leans for sign in (1.0, -1.0)]


def handle_path(root: FloatArray, k: float, sign: float, lean: float) -> list[FloatArray]:
    """Tool poses (4, 4): before the bar, at it with a finger above and one below, pulled out.

    The hand points down by ``lean`` radians.
    """
    out = -root[:3, 0]
    approach = -np.cos(lean) * out - np.sin(lean) * UP
    turned = grasp_rotation(approach, sign * (np.cos(lean) * UP - np.sin(lean) * out))
    bar = at(root, -k * (CABINET[0] / 2 + BAR_OUT), 0.0, k * BAR_HEIGHT)[:3, 3]
    return [rigid(turned, spot) for spot in (bar - STANDOFF * approach, bar, bar + PULL * out)]
