"""A box with a hinged lid, to be opened or closed, and a cabinet whose drawer is pulled open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.solids import at, sample_until, tray
from gvla2.robot.task import Body, Joint, Layout, TaskInstance
from gvla2_plugins.tabletop import OpenBoxConfig, ScaledConfig
from gvla2_plugins.tabletop.scenes import DOWN, UP, Draw, TabletopTask, box, lifted, scaled

BOX, WALL = (0.25, 0.35, 0.15), 0.01
LID, LID_MASS = (0.268, 0.35, 0.01), 0.938
HINGE_RANGE = (-0.253, 2.365)
"""Metres, kilograms; radians from closed to opened as published: our travel counts from where the lid starts."""

TRAVEL = HINGE_RANGE[1] - HINGE_RANGE[0]
YAW = np.pi / 8

HOOK_BEHIND, HOOK_BELOW = 0.018, 0.012
"""Where a hooking tool's centre point is behind and below the lid's edge, metres: half a finger off it."""


@dataclass(frozen=True)
class LidBox:
    """A box about ``root`` (4, 4), its hinge at +x, its lip at -x; ``scale`` times the published size."""

    root: FloatArray
    scale: float

    @property
    def hinge(self) -> FloatArray:
        """(3,) middle of the hinge, world."""
        k = self.scale
        return transform_points(self.root, (k * BOX[0] / 2, 0.0, k * BOX[2] + LID[2] / 2))

    def lid_pose(self, angle: float) -> FloatArray:
        """world_from_lid (4, 4) when the lid is open by ``angle`` radians; its origin is its middle."""
        turn = rigid(self.root[:3, :3] @ Rotation.from_euler("y", angle).as_matrix(), self.hinge)
        return turn @ rigid(translation=(-self.scale * LID[0] / 2, 0.0, 0.0))

    def along_lid(self, angle: float, distance: float) -> FloatArray:
        """(3,) the point of the lid's middle line ``distance`` metres from the hinge, open by ``angle``."""
        pose = self.lid_pose(angle)
        return np.asarray(self.hinge - pose[:3, 0] * distance)

    def bodies(self, angle: float, colours: Sequence[str]) -> tuple[Body, Body]:
        """Box and lid of the two colours, the lid open by ``angle``."""
        k = self.scale
        walls = tray(scaled(k, BOX), WALL, COLOURS[colours[0]])
        lid = box((k * LID[0], k * LID[1], LID[2]), COLOURS[colours[1]])
        return (
            Body("box", walls, self.root, 2.0, fixed=True, label=f"{colours[0]} box", shape="box"),
            Body("lid", (lid,), self.lid_pose(angle), LID_MASS, label="box lid", shape="plate"),
        )

    def joint(self, *, opens: bool) -> Joint:
        """The hinge: travel counts from closed when it ``opens``, else from opened."""
        axis = self.root[:3, 1] * (1.0 if opens else -1.0)
        return Joint(
            "hinge", "revolute", "box", "lid", axis=axis, origin=self.hinge, limits=(0.0, TRAVEL), damping=0.1,
            friction=0.02,
        )  # fmt: skip


def draw_box(draw: Draw, scale: float) -> LidBox | None:
    """A box inside the site, its back away from the robot; None when it is out of place."""
    root = draw.root(YAW)
    half = 0.5 * scale * np.array(BOX[:2])
    corners = [root[:2, 3] + root[:2, :2] @ (half * (x, y)) for x in (-1, 1) for y in (-1, 1)]
    return LidBox(root, scale) if all(draw.site.inside(corner, 0.0) for corner in corners) else None


def shut_paths(lid_box: LidBox, angles: FloatArray) -> list[list[FloatArray]]:
    """Ways to shut the lid through ``angles`` (N,), tool poses (4, 4) each: a hook behind its edge from above, the hand
    either way round.
    """
    ways = []
    for sign in (1.0, -1.0):
        path = hook_path(lid_box, angles, sign)
        behind = rigid(translation=0.03 * lid_box.root[:3, 0]) @ path[0]
        ways.append([rigid(translation=0.05 * UP) @ behind, behind, *path])
    return ways


def lip_path(lid_box: LidBox, angles: FloatArray, beyond: float, sign: float) -> list[FloatArray]:
    """Tool poses (4, 4) of a hand that holds the lip at ``angles`` (N,), pointing to the hinge along the lid.

    The tool centre point is ``beyond`` metres inside the lip's edge; ``sign`` turns the hand over.
    """
    poses = []
    for angle in angles:
        lid = lid_box.lid_pose(float(angle))
        at = lid_box.along_lid(float(angle), lid_box.scale * LID[0] - beyond)
        poses.append(rigid(grasp_rotation(lid[:3, 0], sign * lid[:3, 2]), at))
    return poses


def hook_path(lid_box: LidBox, angles: FloatArray, sign: float) -> list[FloatArray]:
    """Tool poses (4, 4) of a hand that points down and hooks behind the lid's edge at ``angles`` (N,)."""
    back, turned = lid_box.root[:3, 0], grasp_rotation(DOWN, sign * lid_box.root[:3, 1])
    edges = [lid_box.along_lid(float(angle), lid_box.scale * LID[0]) for angle in angles]
    return [rigid(turned, edge + HOOK_BEHIND * back + HOOK_BELOW * DOWN) for edge in edges]


LIP_REACH, STANDOFF = 0.006, 0.06
"""Of the tool centre point inside the lip's edge: the fingertips end before the box's wall; and before the grasp."""

FALLS = 1.0
"""The opening from which a lid falls shut by itself, radians."""

OPEN = np.pi / 2
"""Travel of the lid that counts, radians."""


class OpenBox(TabletopTask[OpenBoxConfig]):
    """Open the box. relaxed: the lid was opened by more than a right angle at some time. strict: it still is."""

    name = "open_box"
    instructions = (
        "open the box",
        "open the lid of the {colour} box",
        "lift the lid of the box until it stays open",
        "swing the {colour} box's lid open",
        "please open that box for me",
    )

    def check(self, config: OpenBoxConfig) -> None:
        """The lid opens by its travel at most."""
        if not 0.0 < config.swing <= TRAVEL:
            raise ConfigurationError(
                f"task=open_box takes task.swing above 0 and up to {TRAVEL:.2f} rad, got {config.swing}."
            )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A closed box whose lid the arm can swing open."""
        angles = np.linspace(0.0, self.config.swing, 6)

        def place() -> LidBox | None:
            lid_box = draw_box(draw, self.scale)
            for path in (
                () if lid_box is None else (lip_path(lid_box, angles, LIP_REACH, s) for s in (1.0, -1.0))
            ):
                if draw.site.follows([path[0] @ lifted(-STANDOFF), *path]):
                    return lid_box
            return None

        lid_box = sample_until(place, "a box")
        colours = draw.colours(2)
        return draw.instance(
            Layout(lid_box.bodies(0.0, colours), (lid_box.joint(opens=True),)),
            lambda world: world.peak("hinge") > OPEN,
            lambda world: world.joint("hinge") > OPEN,
            "relaxed: the lid was opened by more than 90 degrees; strict: it still is",
            colour=colours[0],
        )


SHUT_RELAXED, SHUT_STRICT = 2.4, 2.6
"""Travel of the lid that counts, radians out of 2.618."""


class CloseBox(TabletopTask[ScaledConfig]):
    """Close the box. relaxed: the lid has come 2.4 rad of its 2.618; strict: 2.6 rad."""

    name, largest_scale = "close_box", 1.05
    instructions = (
        "close the box",
        "shut the lid of the {colour} box",
        "close the {colour} box's lid",
        "swing the lid over so that the box is closed",
        "please shut the box",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """An open box whose lid the arm can push shut."""
        angles = np.linspace(TRAVEL, FALLS, 5)

        def place() -> LidBox | None:
            lid_box = draw_box(draw, self.scale)
            return lid_box if lid_box and any(map(draw.site.follows, shut_paths(lid_box, angles))) else None

        lid_box = sample_until(place, "an open box")
        colours = draw.colours(2)
        return draw.instance(
            Layout(lid_box.bodies(TRAVEL, colours), (lid_box.joint(opens=False),)),
            lambda world: world.joint("hinge") > SHUT_RELAXED,
            lambda world: world.joint("hinge") > SHUT_STRICT,
            f"relaxed: the lid has come {SHUT_RELAXED} rad of its {TRAVEL:.3f}; strict: {SHUT_STRICT} rad",
            colour=colours[0],
        )


CABINET, BOARD = (0.24, 0.28, 0.16), 0.012
INNER_GAP = 0.004
SLIDE_TRAVEL, PULLED = 0.18, 0.10
BAR, BAR_LENGTH, BAR_OUT, BAR_HEIGHT = 0.012, 0.11, 0.040, 0.125
"""Metres. The cabinet's front looks to -x of its root; the bar of the handle runs across it, ``BAR_OUT`` before it."""

HANDLE_RGB = (0.25, 0.25, 0.27)

PULL = 0.15
DRAWER_LEANS = (0.0, 0.3, 0.6)
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
        root = sample_until(lambda: self._root(draw), "a cabinet")
        colour, body_colour = draw.colours(2, beside=(HANDLE_RGB,))
        slide = Joint(
            "slide", "prismatic", "cabinet", "drawer", axis=-root[:3, 0], origin=root[:3, 3],
            limits=(0.0, SLIDE_TRAVEL), damping=8.0, friction=0.5,
        )  # fmt: skip
        return draw.instance(
            Layout((_cabinet(self.scale, root, body_colour), _drawer(self.scale, root, colour)), (slide,)),
            lambda world: world.peak("slide") > PULLED,
            lambda world: world.joint("slide") > PULLED,
            f"relaxed: the drawer was pulled out by more than {PULLED:g} m; strict: it still is",
            colour=colour,
        )

    def _root(self, draw: Draw) -> FloatArray | None:
        root, k = draw.root(YAW), self.scale
        x, y = k * CABINET[0] / 2, k * CABINET[1] / 2
        corners = [at(root, sx * x, sy * y)[:2, 3] for sx in (-1, 1) for sy in (-1, 1)]
        if not all(draw.site.inside(corner, 0.0) for corner in corners):
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
    lowest = [k * BAR_HEIGHT + PALM_BACK * np.sin(lean) - HAND_HALF * np.cos(lean) for lean in DRAWER_LEANS]
    leans = [lean for lean, low in zip(DRAWER_LEANS, lowest, strict=True) if low > HAND_ROOM]
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
