"""Put a block on a painted square, a bottle into a tray, objects into bins, a knife on a board."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.solids import Volume, at, clear, on, planar, sample_until, tray
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import (
    DOWN,
    UP,
    Draw,
    Rgb,
    Sides,
    TabletopTask,
    around,
    box,
    cylinder,
    lifted,
    raised,
    scaled,
    square,
)

SIZE, BLOCK_MASS = 0.0608, 0.448
BLOCK_AT, TARGET_AT = (0.025, -0.025), (0.025, 0.15)
TARGET, EASED_AREA, STRICT_AREA = 0.173, 0.17, 0.01
"""Metres, kilograms; places in the root's frame; areas are squares about the target's centre."""

TOUCHING = 0.005
"""Height of the target area's volume, metres: a block that touches it is on the table, or all but."""


class PutBlock(TabletopTask[ScaledConfig]):
    """Put the block on the target. relaxed: it touches the target area. strict: its centre is within 1 cm²."""

    name = "put_block"
    instructions = (
        "put the {colour} block on the {target} square",
        "pick up the {colour} cube and place it on the {target} target",
        "place the {colour} block onto the {target} patch on the table",
        "set the {colour} cube down on the {target} square",
        "could you put the {colour} cube on the {target} square?",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A block and its target."""
        size = SIZE * self.scale
        root = sample_until(lambda: self._root(draw, size), "a block and its target")
        colour, target_colour = draw.colours(2)
        cube = box([size] * 3, COLOURS[colour])
        block = Body("block", (cube,), at(root, *BLOCK_AT, size / 2), BLOCK_MASS, label=f"{colour} cube")
        spot = at(root, *TARGET_AT)
        area = on(spot, (EASED_AREA, EASED_AREA), TOUCHING)
        centre = Volume(spot @ lifted(size / 2), (STRICT_AREA, STRICT_AREA, size))
        return draw.instance(
            Layout((block, square(spot, TARGET, target_colour))),
            lambda world: area.meets(block, world.pose("block")),
            lambda world: centre.holds(world.pose("block")[:3, 3]),
            f"relaxed: the {colour} block touches the {target_colour} square; strict: its centre is within "
            f"{STRICT_AREA / 2 * 1000:g} mm of the square's, along both sides",
            colour=colour,
            target=target_colour,
        )

    def _root(self, draw: Draw, size: float) -> FloatArray | None:
        root = draw.root()
        block, target = at(root, *BLOCK_AT)[:2, 3], at(root, *TARGET_AT)[:2, 3]
        if not draw.site.inside(block, size / np.sqrt(2)) or not draw.site.inside(
            target, TARGET / np.sqrt(2)
        ):
            return None
        return root if all(draw.site.in_reach(xy, size / 2, 0.2) for xy in (block, target)) else None


TRAY, TRAY_WALL = (0.318, 0.318, 0.05), 0.008
OVER_TRAY = (0.325, 0.325, 0.10)
BOTTLE, SHOULDERS, BOTTLE_MASS = (0.10, 0.06, 0.19), 0.17, 0.30
MUSTARD_CAN, CARTON = (0.066, 0.066, 0.10), (0.09, 0.05, 0.13)
"""Metres and kilograms; the bottle is as deep as ``SHOULDERS`` and narrows to its nozzle above."""

YELLOW, RED, BLUE = (1.0, 0.85, 0.0), (0.8, 0.0, 0.0), (0.0, 0.2, 0.8)
GREEN, GREY = (0.0, 0.5, 0.0), (0.4, 0.4, 0.4)

GRASP_DEPTH = 0.034
"""How far below the nozzle's end the hand can grasp before its palm is on it, metres."""

MOST_SPAN = 0.074
"""The hand opens 0.08 m."""


class SortMustard(TabletopTask[ScaledConfig]):
    """Put the mustard bottle into the tray. Both profiles: it rests in a volume of 10 cm over the tray."""

    name = "sort_mustard"
    instructions = (
        "put the mustard bottle in the tray",
        "place the yellow mustard into the gray tray",
        "pick up the yellow bottle and put it in the tray",
        "sort the mustard into the tray",
        "move the yellow mustard bottle into the tray, please",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A tray, the bottle, a can and a carton."""
        length, width, height = scaled(self.scale, BOTTLE)
        size = (length, min(width, MOST_SPAN), height)
        place, *spots = sample_until(lambda: self._poses(draw, size), "a tray and three items")
        shapes = _mustard(size, SHOULDERS * self.scale)
        bottle = Body("bottle", shapes, spots[0], BOTTLE_MASS, label="yellow mustard bottle", shape="box")
        container = Body("tray", tray(TRAY, TRAY_WALL, GREY), place, fixed=True, label="gray tray")
        can = Body(
            "can", (cylinder(MUSTARD_CAN[0], 0, MUSTARD_CAN[2], BLUE),), spots[1], 0.2, label="blue can"
        )
        solid = box(CARTON, GREEN, (0, 0, CARTON[2] / 2))
        carton = Body("carton", (solid,), spots[2], 0.2, label="green carton")
        volume = on(place, OVER_TRAY[:2], OVER_TRAY[2])

        def done(world: WorldState) -> bool:
            return volume.meets(bottle, world.pose("bottle")) and world.resting("bottle")

        return draw.instance(
            Layout((container, bottle, can, carton)),
            done,
            done,
            "the mustard bottle rests in the tray, let go of",
        )

    def _poses(self, draw: Draw, size: tuple[float, float, float]) -> list[FloatArray] | None:
        """Poses (4, 4) of the undersides of tray, bottle, can and carton."""
        root = draw.root()
        spots = np.vstack([root[:2, 3], [draw.root()[:2, 3] for _ in range(3)]])
        yaws = draw.rng.uniform(-np.pi, np.pi, size=3)
        radii = [TRAY[0] / np.sqrt(2), _half_diagonal(size), MUSTARD_CAN[0] / 2, _half_diagonal(CARTON)]
        room = [TRAY[0] / 2, *radii[1:]]
        if not clear(spots, radii, 0.03) or not all(map(draw.site.inside, spots, room)):
            return None
        grasp = size[2] - GRASP_DEPTH
        if not draw.site.in_reach(spots[1], grasp, grasp + 0.12):
            return None
        if not draw.site.in_reach(spots[0], grasp, grasp + 0.15):
            return None
        table = draw.site.table_height
        return [root, *(planar(xy, table, float(yaw)) for xy, yaw in zip(spots[1:], yaws, strict=True))]


def _half_diagonal(size: Sequence[float]) -> float:
    return float(np.hypot(size[0], size[1])) / 2


def _mustard(size: tuple[float, float, float], shoulders: float) -> tuple[Primitive, ...]:
    """Body, shoulder and nozzle of a squeeze bottle that stands on z = 0."""
    length, width, height = size
    middle = (shoulders + height) / 2
    return (
        box((length, width, shoulders), YELLOW, (0, 0, shoulders / 2)),
        cylinder(0.6 * width, shoulders, middle, YELLOW),
        cylinder(0.3 * width, middle, height, RED),
    )


BIN, BIN_WALL = (0.17, 0.17, 0.05), 0.006
OBJECTS = {"cube": (0.045, 0.045, 0.045), "can": (0.045, 0.045, 0.07), "bar": (0.035, 0.07, 0.04)}
MASS, GAP, OVER, ASIDE = 0.1, 0.05, 0.10, 0.035
"""Metres, kilograms: an object is in a bin when its middle is within its walls, no higher than ``OVER``. Two objects of
one colour fit ``ASIDE`` of the bin's middle, on either side."""

SPOTS, RESTARTS = 200, 50
"""Number of places drawn for one layout, and of layouts begun."""


class SortObject(TabletopTask[ScaledConfig]):
    """Put each object into the bin of its own colour. relaxed: all three are in. strict: and let go of, at rest."""

    name = "sort_object"
    instructions = (
        "sort the objects into the bins of the same colour",
        "put every object into the bin that has its colour",
        "put the {one} things in the {one} bin and the {other} things in the {other} bin",
        "sort the {one} and {other} objects into the bins of their own colour",
        "place each object in the box of matching colour",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """Two bins and three objects."""
        poses = sample_until(lambda: self._poses(draw), "two bins and three objects", RESTARTS)
        colours = draw.colours(2)
        belongs = [0, 1, int(draw.rng.integers(2))]
        bins = tuple(
            Body(
                f"bin_{i}",
                tray(BIN, BIN_WALL, COLOURS[c]),
                poses[i],
                fixed=True,
                label=f"{c} bin",
                shape="box",
            )
            for i, c in enumerate(colours)
        )
        objects = []
        for name, size, colour, pose in zip(OBJECTS, self._sizes(), belongs, poses[2:], strict=True):
            solid = Primitive("cylinder" if name == "can" else "box", size, COLOURS[colours[colour]])
            label = f"{colours[colour]} {name}"
            objects.append(Body(name, (solid,), pose @ lifted(size[2] / 2), MASS, label=label))
        inner = BIN[0] - 2 * BIN_WALL
        volumes = [on(pose, (inner, inner), OVER) for pose in poses[:2]]

        def relaxed(world: WorldState) -> bool:
            return all(
                volumes[k].holds(world.pose(obj.name)[:3, 3]) and not world.held(obj.name)
                for obj, k in zip(objects, belongs, strict=True)
            )

        return draw.instance(
            Layout((*bins, *objects)),
            relaxed,
            lambda world: relaxed(world) and all(world.resting(obj.name) for obj in objects),
            "relaxed: each object is in the bin of its colour; strict: at rest there, let go of",
            one=colours[0],
            other=colours[1],
        )

    def _sizes(self) -> list[Sides]:
        return [scaled(self.scale, size) for size in OBJECTS.values()]

    def _poses(self, draw: Draw) -> list[FloatArray] | None:
        """Poses (4, 4) of the undersides of both bins and the three objects, each beside those already placed."""
        roots: list[FloatArray] = []
        for _ in range(SPOTS):
            root = draw.root()
            if self._apart(draw, [*roots, root]) and _reached(draw, len(roots), root):
                roots.append(root)
            if len(roots) == 5:
                return roots
        return None

    def _apart(self, draw: Draw, roots: list[FloatArray]) -> bool:
        """Whether the first of the bins and objects lie in the site, apart from one another."""
        spots = np.stack([root[:2, 3] for root in roots])
        radii = [BIN[0] / np.sqrt(2)] * 2 + [_half_diagonal(size) for size in self._sizes()]
        radii = radii[: len(roots)]
        within = all(draw.site.inside(xy, min(r, BIN[0] / 2)) for xy, r in zip(spots, radii, strict=True))
        return within and clear(spots, radii, GAP)


def _reached(draw: Draw, index: int, root: FloatArray) -> bool:
    """Whether the hand gets to the object, or to both places in the bin."""
    sides = (-1.0, 1.0) if index < 2 else (0.0,)
    return all(draw.site.in_reach(at(root, side * ASIDE, 0.0)[:2, 3], 0.02, 0.24) for side in sides)


STAND, TILT = (0.041, 0.08, 0.155), np.deg2rad(5.0)
SLOT = (0.027, 0.006, 0.125)
GRIP, BLADE = (0.023, 0.015, 0.084), (0.020, 0.002, 0.110)
KNIFE_MASS = 0.06
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
        root, stand = sample_until(lambda: self._poses(draw), "a knife block and a board")
        (colour,) = draw.colours(1, beside=(BLOCK_RGB, STEEL, BOARD_RGB))
        board = box(BOARD, BOARD_RGB, (0, 0, BOARD[2] / 2))
        knife = Body(
            "knife", _knife(k, COLOURS[colour]), _in_slot(stand, k), KNIFE_MASS, label=f"{colour} knife",
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
        if not clear(spots, (BOARD[1] / 2, k * STAND[1]), 0.02) or not draw.site.inside(
            foot[:2, 3], k * 0.05
        ):
            return None
        beside = np.abs(np.linalg.inv(root) @ foot[:, 3])[:2]
        if (beside < np.array(BOARD[:2]) / 2 + k * 0.05).all() or not draw.site.inside(
            root[:2, 3], BOARD[1] / 2
        ):
            return None
        # The lower edge of the leaning block is on the table.
        lean = rigid(Rotation.from_euler("y", TILT).as_matrix(), (0, 0, k * STAND[0] / 2 * np.sin(TILT)))
        stand, follows = foot @ lean, draw.site.follows
        paths = knife_paths(_in_slot(stand, k), root, k)
        feasible = any(follows(out) and any(map(follows, lays)) for out, lays in paths)
        return (root, stand) if feasible else None


def _in_slot(stand: FloatArray, k: float) -> FloatArray:
    """world_from_knife (4, 4): its grip stands on the block's top, its blade in the slot."""
    return stand @ lifted(k * (STAND[2] + GRIP[2] / 2) + 0.0005)


def _knife(k: float, rgb: Rgb) -> tuple[Primitive, ...]:
    """Grip about the origin, blade below it along -z."""
    below = -k * (GRIP[2] + BLADE[2]) / 2
    return box(scaled(k, GRIP), rgb), box(scaled(k, BLADE), STEEL, (0.0, 0.0, below))


def _block(k: float) -> tuple[Primitive, ...]:
    """A block that stands on z = 0 with a slot from above, out of its floor and four walls."""
    (x, y, z), (deep, wide, down) = scaled(k, STAND), scaled(k, SLOT)
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
