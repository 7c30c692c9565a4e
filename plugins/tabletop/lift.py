"""Lift a cube out of several, a cup by its rim, or an umbrella out of its stand."""

from __future__ import annotations

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import clear, planar
from gvla2.robot.solids import Volume, body_points, cup, on, tray
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, WorldState
from gvla2_plugins.tabletop import PickAndLiftConfig, ScaledConfig
from gvla2_plugins.tabletop.scenes import Draw, Rgb, TabletopTask, box, cylinder, lifted, scaled

START_VOLUME = (0.30, 0.30, 0.03)
"""The volume of the relaxed profile, standing on the table about the cube's starting place, metres."""

SENSOR_HEIGHT, SENSOR_THICKNESS = 0.248, 0.05
"""The sensor of the strict profile, metres above the table. Only its height is published; we assume a slab of 5 cm
around that height, triggered by any part of the cube, like a proximity sensor."""


class PickAndLift(TabletopTask[PickAndLiftConfig]):
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

    def check(self, config: PickAndLiftConfig) -> None:
        """There must be a cube."""
        if config.cubes < 1 or config.size <= 0 or config.mass <= 0:
            raise ConfigurationError(
                f"task=pick_and_lift needs at least one cube of positive size and mass, got cubes={config.cubes}, "
                f"size={config.size}, mass={config.mass}."
            )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """Some cubes."""
        size, count, table = self.scale * self.config.size, self.config.cubes, draw.site.table_height
        poses = draw.until(lambda: self._poses(draw, size), f"{count} cubes")
        colours = draw.colours(count)
        own = int(draw.rng.integers(count))
        target, aside = draw.named(colours, own)
        bodies = tuple(
            Body(f"cube_{i}", (box([size] * 3, COLOURS[c]),), poses[i], self.config.mass, label=f"{c} cube")
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
        count, radius, table = self.config.cubes, size / np.sqrt(2.0), draw.site.table_height
        root = draw.root()
        half = 0.5 * np.asarray(self.config.area) - radius
        if (half < 0).any():
            return None
        centres, yaws = _scattered(draw, root, half, count)
        if not clear(centres, [radius] * count, self.config.gap):
            return None
        # Reach last: inverse kinematics costs more than everything else.
        if not all(draw.inside(xy, radius) for xy in centres) or not all(
            draw.in_reach(xy, size / 2, SENSOR_HEIGHT + size) for xy in centres
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
        poses = draw.until(lambda: self._poses(draw, diameter / 2, height), "two cups")
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
        if not clear(centres, [radius, radius], GAP) or not all(draw.inside(xy, radius) for xy in centres):
            return None
        if not all(draw.in_reach(xy, height - 0.02, height + 0.2) for xy in centres):
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
        root = draw.until(lambda: self._root(draw), "an umbrella stand")
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
        if not draw.inside(root[:2, 3], self.scale * STAND[0] / np.sqrt(2)):
            return None
        return root if draw.in_reach(root[:2, 3], handle, handle + 0.12, handle + 0.26) else None


def _umbrella(k: float, rgb: Rgb) -> tuple[Primitive, ...]:
    """Folds, shaft and handle of a folded umbrella that stands on z = 0, ``k`` times its size; metres."""
    low, high = (k * (HANDLE_AT + side * HANDLE[2] / 2) - STAND_WALL for side in (-1, 1))
    folds = 0.85 * low
    return (
        cylinder(k * FOLDS, 0.0, folds, rgb),
        cylinder(k * SHAFT, folds, low, SHAFT_RGB),
        cylinder(k * HANDLE[0], low, high, rgb),
    )
