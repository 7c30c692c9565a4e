"""Unscrew the lid of one of two jars, or the cap of a wine bottle."""

from __future__ import annotations

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import COLOURS
from gvla2.robot.solids import Volume, at, clear, on, sample_until
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, Thread, WorldState
from gvla2_plugins.tabletop import OpenJarConfig, ScaledConfig
from gvla2_plugins.tabletop.scenes import UP, Draw, TabletopTask, box, cylinder, lifted, scaled, square

LID, LID_MASS = (0.074, 0.021), 0.05
JAR = (0.066, 0.12)
SPAWN, YAW, GAP = (0.333, 0.373), 0.6 * np.pi, 0.10
LEFT, LEFT_HEIGHT = 0.35, 0.12
PUT_AT, PUT, PUT_HEIGHT = (0.043, 0.277), 0.05, 0.02
PATCH = 0.10
"""Metres, kilograms: diameters and heights; the relaxed volume is about the lid's starting place."""

FINGER_ROOM, OVERHANG = 0.006, 0.006
"""The lid is this much narrower than the hand opens at most, and the jar than the lid; metres."""

LID_RGB = (0.55, 0.57, 0.60)

Sizes = tuple[tuple[float, float], tuple[float, float]]
"""Diameter and height of lid and jar, metres."""


class OpenJar(TabletopTask[OpenJarConfig]):
    """Open the jar of the named colour. relaxed: its lid has left a volume about its place. strict: the lid lies on
    the painted patch beside the jars, let go of.
    """

    name = "open_jar"
    instructions = (
        "open the {colour} jar and put its lid on the {target} square",
        "unscrew the lid of the {colour} jar and lay it on the {target} square",
        "twist the lid off the {colour} jar and place it on the {target} square",
        "take the lid off the {colour} jar and put it on the {target} square",
        "unscrew the {colour} jar's lid and set it down on the {target} square",
        "please open that {colour} jar for me and leave the lid on the {target} square",
    )
    """Each says where to put the lid: the strict rule requires it, and only the sentence says it."""

    def check(self, config: OpenJarConfig) -> None:
        """The wrist turns at most half a turn."""
        if not 0 < config.turn <= 180:
            raise ConfigurationError(f"task=open_jar needs task.turn in (0, 180] degrees, got {config.turn}.")

    def lay_out(self, draw: Draw) -> TaskInstance:
        """Two jars and a painted patch; lid and jar no broader than the hand can hold."""
        k, most = self.scale, draw.site.span - FINGER_ROOM
        sizes = ((min(k * LID[0], most), k * LID[1]), (min(k * JAR[0], most - OVERHANG), k * JAR[1]))
        root, spots = sample_until(lambda: self._poses(draw, sizes), "two jars")
        *colours, patch = draw.colours(3, beside=(LID_RGB,))
        target, aside = draw.named(colours, 0)
        release = float(np.deg2rad(self.config.turn))
        bodies, threads = [], []
        for i, (spot, colour) in enumerate(zip(spots, colours, strict=True)):
            jar, lid = _jar(i, spot, colour, sizes)
            bodies += [jar, lid]
            threads.append(_thread(f"thread_{i}", jar, lid, release, (0.0, np.pi)))
        place = at(root, *PUT_AT)
        jar, lid = bodies[2 * target : 2 * target + 2]
        about = Volume(lid.world_from_body, (LEFT, LEFT, LEFT_HEIGHT))
        put = on(place, (PUT, PUT), PUT_HEIGHT)
        return draw.instance(
            Layout((*bodies, square(place, PATCH, patch, "patch")), threads=tuple(threads)),
            lambda world: not about.meets(lid, world.pose(lid.name)),
            lambda world: put.holds(world.pose(lid.name)[:3, 3]) and world.resting(lid.name),
            f"relaxed: the lid is off the {colours[target]} jar and away; "
            f"strict: it lies on the {patch} square{aside}",
            colour=colours[0],
            target=patch,
        )  # fmt: skip

    def _poses(self, draw: Draw, sizes: Sizes) -> tuple[FloatArray, list[FloatArray]] | None:
        """The root and the poses (4, 4) of the jars' undersides."""
        root, radius = draw.root(YAW), sizes[0][0] / 2
        half = 0.5 * np.asarray(SPAWN) - radius
        jars = []
        for x, y in (draw.rng.uniform(-half, half) for _ in range(2)):
            jars.append(at(root, float(x), float(y), 0.0, draw.angle()))
        place = at(root, *PUT_AT)[:2, 3]
        spots = np.stack([*(jar[:2, 3] for jar in jars), place])
        radii = [radius, radius, PATCH / np.sqrt(2)]
        if not clear(spots, radii, GAP / 2) or not clear(spots[:2], radii[:2], GAP):
            return None
        if not all(map(draw.site.inside, spots, radii)):
            return None
        top = sizes[1][1] + sizes[0][1]
        if not all(draw.site.in_reach(xy, top, top + 0.15) for xy in spots[:2]):
            return None
        return (root, jars) if draw.site.in_reach(place, 0.02, top + 0.15) else None


def _jar(i: int, spot: FloatArray, colour: str, sizes: Sizes) -> tuple[Body, Body]:
    (lid_width, lid_height), (width, height) = sizes
    glass = cylinder(width, 0.0, height, COLOURS[colour])
    disc = Primitive("cylinder", (lid_width, lid_width, lid_height), LID_RGB)
    top = spot @ lifted(height + lid_height / 2)
    return (
        Body(f"jar_{i}", (glass,), spot, 0.4, fixed=True, label=f"{colour} jar"),
        Body(f"lid_{i}", (disc,), top, LID_MASS, label="gray lid"),
    )


def _thread(name: str, jar: Body, lid: Body, release: float, limits: tuple[float, float]) -> Thread:
    return Thread(name, jar.name, lid.name, UP, lid.world_from_body[:3, 3], release, limits)


BOTTLE, NECK = (0.074, 0.20), 0.022
CAP, CAP_AT, CAP_MASS = (0.028, 0.028, 0.008), 0.29, 0.01
RELEASE = np.deg2rad(150.0)
CAP_LEFT = (0.03, 0.03, 0.03)
"""Metres, kilograms, radians. The cap turns by pi either way; the volume that it leaves is about its place."""

GLASS, GOLD = (0.05, 0.25, 0.12), (0.95, 0.75, 0.10)


class OpenWine(TabletopTask[ScaledConfig]):
    """Take the cap off the bottle. Both profiles: it was turned by 150 degrees, and has left its place."""

    name = "open_wine"
    instructions = (
        "open the wine bottle",
        "unscrew the cap of the wine bottle",
        "twist the cap off the bottle and lift it",
        "take the yellow cap off the wine bottle",
        "please uncap the wine",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A wine bottle."""
        k = self.scale
        root = sample_until(lambda: self._root(draw), "a wine bottle")
        shoulder, neck, mouth = k * BOTTLE[1], k * (BOTTLE[1] + 0.02), k * (CAP_AT - CAP[2] / 2)
        glass = (
            cylinder(k * BOTTLE[0], 0.0, shoulder, GLASS),
            cylinder(k * (BOTTLE[0] + NECK) / 2, shoulder, neck, GLASS),
            cylinder(k * NECK, neck, mouth, GLASS),
        )
        size = scaled(k, CAP)
        place = root @ lifted(mouth + size[2] / 2)
        cap = Body("cap", (box(size, GOLD),), place, CAP_MASS, label="yellow cap", shape="disc")
        bottle = Body("bottle", glass, root, 1.2, fixed=True, label="green wine bottle", shape="cylinder")
        about = Volume(place, scaled(k, CAP_LEFT), round=True)

        def done(world: WorldState) -> bool:
            return world.loose("thread") and not about.meets(cap, world.pose("cap"))

        return draw.instance(
            Layout((bottle, cap), threads=(_thread("thread", bottle, cap, RELEASE, (-np.pi, np.pi)),)),
            done,
            done,
            "the cap was turned by 150 degrees and has left the bottle's mouth",
            image_size=512,
        )

    def _root(self, draw: Draw) -> FloatArray | None:
        root, top = draw.root(), self.scale * CAP_AT
        if not draw.site.inside(root[:2, 3], self.scale * BOTTLE[0] / 2):
            return None
        return root if draw.site.in_reach(root[:2, 3], top, top + 0.14) else None
