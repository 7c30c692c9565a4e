"""Unscrew the lid of one of two jars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import at, clear, in_reach, inside, sample_root, sample_until
from gvla2.robot.solids import Volume, on
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, Thread, WorldState
from gvla2_plugins.tabletop import OpenJarConfig
from gvla2_plugins.tabletop.scenes import lifted, named_by_colour, sample_colours, sentence_of, square
from gvla2_plugins.tabletop.screws import unscrew

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


@dataclass(frozen=True)
class _Sizes:
    """Diameter and height of lid and jar, metres."""

    lid: tuple[float, float]
    jar: tuple[float, float]


class OpenJar:
    """Open the jar of the named colour. relaxed: its lid has left a volume about its place. strict: the lid lies on
    the painted patch beside the jars, let go of.
    """

    instructions = (
        "open the {colour} jar and put its lid on the {target} square",
        "unscrew the lid of the {colour} jar and lay it on the {target} square",
        "twist the lid off the {colour} jar and place it on the {target} square",
        "take the lid off the {colour} jar and put it on the {target} square",
        "unscrew the {colour} jar's lid and set it down on the {target} square",
        "please open that {colour} jar for me and leave the lid on the {target} square",
    )
    """Paraphrases; ``{colour}`` is the jar's colour, ``{target}`` the patch's.

    Each says where to put the lid: the strict rule requires it, and only the sentence says it.
    """

    def __init__(self, config: OpenJarConfig) -> None:
        if not 0 < config.turn <= 180:
            raise ConfigurationError(f"task=open_jar needs task.turn in (0, 180] degrees, got {config.turn}.")
        self._scale = config.factor("open_jar")
        self._turn = float(np.deg2rad(config.turn))

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; a given ``instruction`` decides the jar if it names the colour of exactly one."""
        sizes = self._fitting(site.span)
        root, spots = sample_until(lambda: self._draw(rng, site, sizes), "two jars")
        *colours, patch = sample_colours(rng, site, 3, beside=(LID_RGB,))
        target, aside = named_by_colour(instruction, colours, 0)
        bodies, threads = [], []
        for i, (spot, colour) in enumerate(zip(spots, colours, strict=True)):
            jar, lid = _bodies(i, spot, colour, sizes)
            bodies += [jar, lid]
            threads.append(
                Thread(
                    f"thread_{i}", jar.name, lid.name, np.array([0.0, 0.0, 1.0]), lid.world_from_body[:3, 3],
                    release=self._turn, limits=(0.0, np.pi),
                )
            )  # fmt: skip
        place = at(root, *PUT_AT)
        bodies.append(square(place, PATCH, patch, "patch"))
        lid = bodies[2 * target + 1]
        about = Volume(lid.world_from_body, (LEFT, LEFT, LEFT_HEIGHT))
        put = on(place, (PUT, PUT), PUT_HEIGHT)

        def relaxed(world: WorldState) -> bool:
            return not about.meets(lid, world.pose(lid.name))

        def strict(world: WorldState) -> bool:
            return put.holds(world.pose(lid.name)[:3, 3]) and world.resting(lid.name)

        return TaskInstance(
            Layout(tuple(bodies), threads=tuple(threads)),
            sentence_of(rng, self.instructions, instruction, colour=colours[0], target=patch),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the lid is off the {colours[target]} jar and away; "
            f"strict: it lies on the {patch} square{aside}",
            solution=unscrew(
                lid.name, bodies[2 * target].name, turns=(np.deg2rad(105.0),), depth=0.3 * sizes.lid[1], lift=0.12,
                square=False, put=("patch", sizes.lid[1]),
            ),
        )  # fmt: skip

    def _fitting(self, span: float) -> _Sizes:
        """Jar and lid, no broader than a hand that opens by ``span`` can hold."""
        k, most = self._scale, span - FINGER_ROOM
        return _Sizes((min(k * LID[0], most), k * LID[1]), (min(k * JAR[0], most - OVERHANG), k * JAR[1]))

    def _draw(
        self, rng: np.random.Generator, site: TaskSite, sizes: _Sizes
    ) -> tuple[FloatArray, list[FloatArray]] | None:
        """The root and the poses (4, 4) of the jars' undersides."""
        root, radius = sample_root(rng, site, YAW), sizes.lid[0] / 2
        half = 0.5 * np.asarray(SPAWN) - radius
        jars = [
            at(root, float(x), float(y), 0.0, float(rng.uniform(-np.pi, np.pi)))
            for x, y in (rng.uniform(-half, half) for _ in range(2))
        ]
        place = at(root, *PUT_AT)[:2, 3]
        spots = np.stack([*(jar[:2, 3] for jar in jars), place])
        radii = [radius, radius, PATCH / np.sqrt(2)]
        if not clear(spots, radii, GAP / 2) or not clear(spots[:2], radii[:2], GAP):
            return None
        if not all(inside(site, xy, r) for xy, r in zip(spots, radii, strict=True)):
            return None
        top = sizes.jar[1] + sizes.lid[1]
        if not all(in_reach(site, xy, (top, top + 0.15)) for xy in spots[:2]):
            return None
        return (root, jars) if in_reach(site, place, (0.02, top + 0.15)) else None


def _bodies(i: int, spot: FloatArray, colour: str, sizes: _Sizes) -> tuple[Body, Body]:
    (width, height), (lid_width, lid_height) = sizes.jar, sizes.lid
    glass = Primitive("cylinder", (width, width, height), COLOURS[colour], lifted(height / 2))
    disc = Primitive("cylinder", (lid_width, lid_width, lid_height), LID_RGB)
    top = spot @ lifted(height + lid_height / 2)
    return (
        Body(f"jar_{i}", (glass,), spot, 0.4, fixed=True, label=f"{colour} jar"),
        Body(f"lid_{i}", (disc,), top, LID_MASS, label="gray lid"),
    )
