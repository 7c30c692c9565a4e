"""Lift a cube, a cup or an umbrella; push a block onto a square or the button of a lamp."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.colours import COLOURS
from gvla2.robot.solids import Volume, body_points, clear, cup, on, planar, sample_until, tray
from gvla2.robot.task import Body, Glow, Joint, Layout, Primitive, TaskInstance, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import DOWN, PAINT, Draw, Rgb, TabletopTask, box, cylinder, lifted, scaled

CUBES, CUBE_SIZE, CUBE_MASS = 3, 0.05, 0.125
CUBES_AREA, CUBES_GAP = (0.43, 0.565), 0.10
"""Metres and kilograms: the area about the root that the cubes lie in, and the room between them."""

START_VOLUME = (0.30, 0.30, 0.03)
"""The volume of the relaxed profile, standing on the table about the cube's starting place, metres."""

SENSOR_HEIGHT, SENSOR_THICKNESS = 0.248, 0.05
"""The sensor of the strict profile, metres above the table. Only its height is published; we assume a slab of 5 cm
around that height, triggered by any part of the cube, like a proximity sensor."""


class PickAndLift(TabletopTask[ScaledConfig]):
    """Lift the cube of the named colour.

    relaxed: the cube has left a volume of 0.3 x 0.3 x 0.03 m that stands on the table about its starting place: no
    part of it is below the volume's top, or its centre is beyond the volume's sides. strict: both fingers hold the
    cube and some part of it is in the sensor's slab.
    """

    name = "pick_and_lift"
    instructions = (
        "pick up the {colour} cube and lift it up",
        "lift the {colour} block off the table",
        "grab the {colour} cube and raise it into the air",
        "take the {colour} block and hold it up high",
        "could you pick up the {colour} cube, please?",
        "grasp the cube that is {colour} and lift it up to the target height",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """Some cubes."""
        size, table = self.scale * CUBE_SIZE, draw.site.table_height
        poses = sample_until(lambda: self._poses(draw, size), f"{CUBES} cubes")
        colours = draw.colours(CUBES)
        own = int(draw.rng.integers(CUBES))
        target, aside = draw.named(colours, own)
        bodies = tuple(
            Body(f"cube_{i}", (box([size] * 3, COLOURS[c]),), poses[i], CUBE_MASS, label=f"{c} cube")
            for i, c in enumerate(colours)
        )
        cube, start = bodies[target], poses[target]

        def relaxed(world: WorldState) -> bool:
            pose = world.pose(cube.name)
            offset = transform_points(invert_rigid(start), pose[:3, 3])
            low = body_points(cube, pose)[:, 2].min()
            within = np.abs(offset[:2]) <= 0.5 * np.asarray(START_VOLUME[:2])
            return not (within.all() and low <= table + START_VOLUME[2])

        def strict(world: WorldState) -> bool:
            heights = body_points(cube, world.pose(cube.name))[:, 2] - table - SENSOR_HEIGHT
            sensed = heights.min() <= SENSOR_THICKNESS / 2 and heights.max() >= -SENSOR_THICKNESS / 2
            return world.held(cube.name) and bool(sensed)

        return draw.instance(
            Layout(bodies),
            relaxed,
            strict,
            f"relaxed: the {colours[target]} cube has left its place on the table; "
            f"strict: the fingers hold it about {SENSOR_HEIGHT} m above the table{aside}",
            colour=colours[own],
        )

    def _poses(self, draw: Draw, size: float) -> list[FloatArray] | None:
        """Poses (4, 4) of all cubes in the area about a random root; None when one is out of place."""
        radius, table = size / np.sqrt(2.0), draw.site.table_height
        root = draw.root()
        centres, yaws = _scattered(draw, root, 0.5 * np.asarray(CUBES_AREA) - radius, CUBES)
        if not clear(centres, [radius] * CUBES, CUBES_GAP):
            return None
        # Reach last: inverse kinematics costs more than everything else.
        if not all(draw.site.inside(xy, radius) for xy in centres) or not all(
            draw.site.in_reach(xy, size / 2, SENSOR_HEIGHT + size) for xy in centres
        ):
            return None
        return [planar(xy, table + size / 2, yaw) for xy, yaw in zip(centres, yaws, strict=True)]


def _scattered(draw: Draw, root: FloatArray, half: FloatArray, count: int) -> tuple[FloatArray, list[float]]:
    """World places (count, 2) within ``half`` (2,) of the root, and yaws."""
    spots = draw.rng.uniform(-half, half, size=(count, 2))
    yaws = draw.rng.uniform(-np.pi, np.pi, size=count)
    return transform_points(root, np.column_stack([spots, np.zeros(count)]))[:, :2], yaws.tolist()


DIAMETER, HEIGHT, CUP_WALL, CUP_MASS = 0.093, 0.147, 0.004, 0.053
AREA = (0.40, 0.60)
STOOD_IN = (0.05, 0.05, 0.025)
"""Metres and kilograms; the volume stands on the table where the cup stood."""

GAP = 0.10
"""Between the cups, metres: room for fingers and palm."""


class PickupCup(TabletopTask[ScaledConfig]):
    """Pick up the cup of the named colour, beside another. Both profiles: held, and out of the volume it stood in."""

    name = "pickup_cup"
    instructions = (
        "pick up the {colour} cup",
        "grab the {colour} mug and lift it",
        "lift the {colour} cup off the table",
        "take the {colour} cup by its rim and hold it up",
        "please raise the {colour} mug",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """Two cups, wider than the hand opens."""
        diameter, height = DIAMETER * self.scale, HEIGHT * self.scale
        poses = sample_until(lambda: self._poses(draw, diameter / 2, height), "two cups")
        colours = draw.colours(2)
        target, aside = draw.named(colours, 0)
        bodies = []
        for i, colour in enumerate(colours):
            solids = cup(diameter, height, CUP_WALL, COLOURS[colour])
            bodies.append(
                Body(f"cup_{i}", solids, poses[i], CUP_MASS, label=f"{colour} cup", shape="cylinder")
            )
        body = bodies[target]
        volume = on(body.world_from_body, STOOD_IN[:2], STOOD_IN[2])

        def done(world: WorldState) -> bool:
            return world.held(body.name) and not volume.meets(body, world.pose(body.name))

        return draw.instance(
            Layout(tuple(bodies)),
            done,
            done,
            f"the fingers hold the {colours[target]} cup, out of the place where it stood{aside}",
            colour=colours[0],
        )

    def _poses(self, draw: Draw, radius: float, height: float) -> list[FloatArray] | None:
        """Poses (4, 4) of both cups' undersides."""
        root = draw.root()
        centres, yaws = _scattered(draw, root, 0.5 * np.asarray(AREA) - radius, 2)
        if not clear(centres, [radius, radius], GAP) or not all(
            draw.site.inside(xy, radius) for xy in centres
        ):
            return None
        if not all(draw.site.in_reach(xy, height - 0.02, height + 0.2) for xy in centres):
            return None
        return [planar(xy, draw.site.table_height, yaw) for xy, yaw in zip(centres, yaws, strict=True)]


STAND, STAND_WALL = (0.10, 0.10, 0.20), 0.005
HANDLE_AT, HANDLE = 0.257, (0.024, 0.024, 0.060)
FOLDS, SHAFT = 0.056, 0.012
LEFT = (0.08, 0.08, 0.10)
UMBRELLA_MASS = 0.15
"""Metres and kilograms. The umbrella stands on its flat end in the stand, its handle's middle at ``HANDLE_AT``."""

STAND_RGB, SHAFT_RGB = (0.30, 0.30, 0.32), (0.75, 0.75, 0.75)


class TakeUmbrella(TabletopTask[ScaledConfig]):
    """Take the umbrella out. Both profiles: no part of it is in the upper half of the stand any more."""

    name = "take_umbrella"
    instructions = (
        "take the umbrella out of the stand",
        "pull the {colour} umbrella out of the umbrella stand",
        "lift the umbrella out of its holder",
        "remove the {colour} umbrella from the stand",
        "grab the umbrella by its handle and pull it out",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """An umbrella in its stand."""
        k = self.scale
        root = sample_until(lambda: self._root(draw), "an umbrella stand")
        (colour,) = draw.colours(1, beside=(STAND_RGB, SHAFT_RGB))
        size = scaled(k, STAND)
        walls = tray(size, STAND_WALL, STAND_RGB)
        stand = Body("stand", walls, root, fixed=True, label="gray umbrella stand", shape="box")
        umbrella = Body(
            "umbrella", _umbrella(k, COLOURS[colour]), root @ lifted(STAND_WALL), UMBRELLA_MASS,
            label=f"{colour} umbrella", shape="cylinder", parts=(("handle", (2,)),),
        )  # fmt: skip
        volume = Volume(root @ lifted(0.75 * size[2]), (k * LEFT[0], k * LEFT[1], size[2] / 2))

        def done(world: WorldState) -> bool:
            return not volume.meets(umbrella, world.pose("umbrella"))

        return draw.instance(
            Layout((stand, umbrella)),
            done,
            done,
            f"the {colour} umbrella has left the stand",
            colour=colour,
        )

    def _root(self, draw: Draw) -> FloatArray | None:
        root, handle = draw.root(), self.scale * HANDLE_AT
        if not draw.site.inside(root[:2, 3], self.scale * STAND[0] / np.sqrt(2)):
            return None
        return root if draw.site.in_reach(root[:2, 3], handle, handle + 0.12, handle + 0.26) else None


def _umbrella(k: float, rgb: Rgb) -> tuple[Primitive, ...]:
    """Folds, shaft and handle of a folded umbrella that stands on z = 0, ``k`` times its size; metres."""
    low, high = (k * (HANDLE_AT + side * HANDLE[2] / 2) - STAND_WALL for side in (-1, 1))
    folds = 0.85 * low
    return (
        cylinder(k * FOLDS, 0.0, folds, rgb),
        cylinder(k * SHAFT, folds, low, SHAFT_RGB),
        cylinder(k * HANDLE[0], low, high, rgb),
    )


BLOCK_SIZE, BLOCK_MASS, TARGET, DISTANCE = 0.0563, 0.356, 0.10, (0.15, 0.30)
"""Side of the block and of the target, metres; kilograms; distance of the block from the target's centre, metres."""

CENTRE_VOLUME = 0.01
"""Side of the strict profile's cube at the target's centre, metres."""

ROOM_BEHIND = 0.08
"""How far behind the block, seen from the target, the hand must reach to push it, metres."""


class PushBlock(TabletopTask[ScaledConfig]):
    """Push the block onto the target.

    relaxed: the block's centre is above the painted square and the block lies on the table. strict: the block
    overlaps a cube of 1 cm that stands at the target's centre.
    """

    name = "push_block"
    instructions = (
        "push the {colour} block onto the {target} square",
        "slide the {colour} cube to the {target} target",
        "shove the {colour} block over to the {target} patch on the table",
        "move the {colour} cube onto the {target} square by pushing it",
        "without lifting it, push the {colour} block until it is on the {target} target",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A block and its target."""
        size, table = self.scale * BLOCK_SIZE, draw.site.table_height
        start, spot = sample_until(lambda: self._poses(draw, size), "a block and its target")
        colour, target_colour = draw.colours(2)
        block = Body("block", (box([size] * 3, COLOURS[colour]),), start, BLOCK_MASS, label=f"{colour} cube")
        paint = box((TARGET, TARGET, PAINT), COLOURS[target_colour], collides=False)
        target = Body("target", (paint,), spot, fixed=True, label=f"{target_colour} square")
        middle = rigid(spot[:3, :3], (spot[0, 3], spot[1, 3], table + CENTRE_VOLUME / 2))
        volume = Volume(middle, (CENTRE_VOLUME, CENTRE_VOLUME, CENTRE_VOLUME))

        def relaxed(world: WorldState) -> bool:
            now = world.pose("block")[:3, 3]
            offset = transform_points(invert_rigid(spot), now)
            return bool((np.abs(offset[:2]) <= TARGET / 2).all() and now[2] < table + size)

        return draw.instance(
            Layout((block, target)),
            relaxed,
            lambda world: volume.meets(block, world.pose("block")),
            f"relaxed: the {colour} block's centre is on the {target_colour} square; "
            "strict: the block covers the square's centre",
            colour=colour,
            target=target_colour,
        )

    def _poses(self, draw: Draw, size: float) -> tuple[FloatArray, FloatArray] | None:
        """Poses (4, 4) of the block's and the paint's centre; None when one is out of place."""
        root = draw.root()
        distance = float(draw.rng.uniform(*DISTANCE))
        direction, block_yaw, target_yaw = draw.rng.uniform(-np.pi, np.pi, size=3)
        start = root[:2, 3]
        towards = np.array([np.cos(direction), np.sin(direction)])
        goal = start + distance * towards
        free = distance - (size + TARGET) / np.sqrt(2.0) > 0
        if (
            not free
            or not draw.site.inside(start, size / np.sqrt(2.0))
            or not draw.site.inside(goal, TARGET / np.sqrt(2))
        ):
            return None
        if not all(draw.site.in_reach(xy, size / 2, 0.15) for xy in (start - ROOM_BEHIND * towards, goal)):
            return None
        table = draw.site.table_height
        return (
            planar(start, table + size / 2, float(block_yaw)),
            planar(goal, table + PAINT / 2, float(target_yaw)),
        )


EASED_TRAVEL, STRICT_TRAVEL = 0.003, 0.0075
"""Travel of the button that counts, metres."""

LAMP_DIAMETER, LAMP_HEIGHT, TRAVEL, STIFFNESS = 0.033, 0.024, 0.010, 400.0
"""The button: its top above the table and its travel, metres; N/m."""

LAMP_BASE = (0.16, 0.08, 0.010)
BUTTON_X, POST_X = -0.045, 0.045
POST = (0.014, 0.014, 0.055)
SHADE = (0.060, 0.060, 0.035)
"""The lamp, metres. It stays below the hand's palm when the fingers press the button, so that any yaw of the hand
has room."""

BASE_RGB, POST_RGB, SHADE_RGB = (0.16, 0.16, 0.18), (0.20, 0.20, 0.22), (0.28, 0.27, 0.26)

SHADE_SOLID, LIT_RGB = 2, (1.0, 0.93, 0.62)
"""Which solid of the lamp shines when it is on, and how."""

PRELOAD = 0.002
"""How far beyond its stop the spring rests, metres: the button carries its own weight without sinking."""


class LampOn(TabletopTask[ScaledConfig]):
    """Press the button of a lamp. Success is the largest travel of the button, since a spring brings it back.

    relaxed: more than 3 mm. strict: more than 7.5 mm, of 10 mm.
    """

    name = "lamp_on"
    instructions = (
        "turn on the lamp",
        "press the {colour} button to switch the lamp on",
        "push the {colour} button of the lamp",
        "switch the light on by pressing the {colour} button",
        "press the lamp's button",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A lamp and its button."""
        root = sample_until(lambda: self._root(draw), "a lamp")
        (colour,) = draw.colours(1, beside=(BASE_RGB, POST_RGB, SHADE_RGB))
        height = LAMP_HEIGHT - LAMP_BASE[2]
        diameter, post_top = self.scale * LAMP_DIAMETER, LAMP_BASE[2] + POST[2]
        solids = (
            Primitive("box", LAMP_BASE, BASE_RGB, lifted(LAMP_BASE[2] / 2)),
            Primitive("cylinder", POST, POST_RGB, lifted(LAMP_BASE[2] + POST[2] / 2, POST_X)),
            Primitive("cylinder", SHADE, SHADE_RGB, lifted(post_top + SHADE[2] / 2, POST_X)),
        )
        lamp = Body("lamp", solids, root, mass=0.5, fixed=True)
        centre = root @ lifted(LAMP_BASE[2] + height / 2, BUTTON_X)
        plate = Primitive("cylinder", (diameter, diameter, height), COLOURS[colour])
        button = Body("button", (plate,), centre, mass=0.02, label=f"{colour} button")
        slide = Joint(
            "press", "prismatic", "lamp", "button", axis=DOWN, origin=centre[:3, 3], limits=(0.0, TRAVEL),
            rest=-PRELOAD, stiffness=STIFFNESS, damping=4.0,
        )  # fmt: skip
        return draw.instance(
            Layout((lamp, button), (slide,), (Glow("lamp", SHADE_SOLID, "press", STRICT_TRAVEL, LIT_RGB),)),
            lambda world: world.peak("press") > EASED_TRAVEL,
            lambda world: world.peak("press") > STRICT_TRAVEL,
            f"relaxed: the button went down by more than {EASED_TRAVEL * 1000:g} mm; "
            f"strict: by more than {STRICT_TRAVEL * 1000:g} mm",
            colour=colour,
        )

    def _root(self, draw: Draw) -> FloatArray | None:
        """Pose (4, 4) of the middle of the base's underside; None when it is out of place."""
        root = draw.root()
        button = transform_points(root, (BUTTON_X, 0.0, 0.0))[:2]
        if not draw.site.inside(root[:2, 3], 0.5 * float(np.hypot(LAMP_BASE[0], LAMP_BASE[1]))):
            return None
        return root if draw.site.in_reach(button, 0.01, LAMP_HEIGHT + 0.15) else None
