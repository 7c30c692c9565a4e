"""Slip a square ring over one of three pillars, which is named by its colour."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.placing import at, in_reach, inside, sample_root, sample_until
from gvla2.robot.solids import square_ring
from gvla2.robot.task import Body, Layout, Primitive, Solution, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import DOWN, UP, best_path, raised, through
from gvla2_plugins.tabletop.scenes import named_by_colour, sample_colours, sentence_of

PILLAR, PILLARS_AT = (0.025, 0.025, 0.12), (-0.125, 0.0, 0.125)
RING, HOLE, MASS = (0.05, 0.05, 0.01), 0.03, 0.02
SPAWN, SPAWN_AT = (0.40, 0.20), (0.0, -0.20)
"""Metres, kilograms, in the root's frame. The hole leaves 2.5 mm about the pillar."""

SMOOTH = 0.2
"""Friction of ring and pillars: a wooden ring on a lacquered pillar slides down by itself."""

LOW = 0.005
"""A ring is at the foot if it is at most this far above its flat position, metres."""

IMAGE_SIZE = 512


class InsertBlock:
    """Put the ring over the named pillar. relaxed: it lies about the pillar's foot. strict: the same, and released."""

    instructions = (
        "put the ring on the {colour} pillar",
        "slide the square ring over the {colour} peg",
        "insert the ring onto the {colour} pillar",
        "place the ring around the {colour} post",
        "drop the ring over the {colour} pillar",
    )
    """Paraphrases; ``{colour}`` is the pillar's colour."""

    def __init__(self, config: ScaledConfig) -> None:
        self._scale = config.factor("insert_block")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; a given ``instruction`` decides the pillar if it names the colour of exactly one."""
        k = self._scale
        root, start = sample_until(lambda: self._draw(rng, site), "a ring and three pillars")
        ring_colour, *colours = sample_colours(rng, site, 4)
        named = int(rng.integers(3))
        target, aside = named_by_colour(instruction, colours, named)
        x, y, z = (k * side for side in PILLAR)
        pillars = tuple(
            Body(
                f"pillar_{i}", (Primitive("box", (x, y, z), COLOURS[c]),), at(root, k * place, 0.0, z / 2), fixed=True,
                friction=SMOOTH, label=f"{c} pillar",
            )
            for i, (place, c) in enumerate(zip(PILLARS_AT, colours, strict=True))
        )  # fmt: skip
        outer = k * RING[0], k * RING[1], k * RING[2]
        walls = square_ring(outer, k * (RING[0] - HOLE) / 2, COLOURS[ring_colour], -outer[2] / 2)
        ring = Body("ring", walls, start, MASS, friction=SMOOTH, label=f"{ring_colour} ring", shape="ring")
        pillar = pillars[target]
        room = k * (HOLE - PILLAR[0]) / 2

        def relaxed(world: WorldState) -> bool:
            pose = world.pose("ring")
            off = transform_points(invert_rigid(pillar.world_from_body), pose[:3, 3])
            at_foot = pose[2, 3] < site.table_height + outer[2] / 2 + LOW
            return bool(np.abs(off[:2]).max() < np.sqrt(2) * room and at_foot)

        def strict(world: WorldState) -> bool:
            return relaxed(world) and world.resting("ring")

        return TaskInstance(
            Layout((*pillars, ring)),
            sentence_of(rng, self.instructions, instruction, colour=colours[named]),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the ring lies about the foot of the {colours[target]} pillar; strict: let go of, at rest{aside}",
            image_size=IMAGE_SIZE,
            solution=slip_over(pillar.name, z, outer[0], outer[2], [p.name for p in pillars]),
        )

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> tuple[FloatArray, FloatArray] | None:
        k, root = self._scale, sample_root(rng, site)
        half = 0.5 * np.asarray(SPAWN) - k * RING[0] / np.sqrt(2)
        x, y = np.asarray(SPAWN_AT) + rng.uniform(-half, half)
        start = at(root, x, y, k * RING[2] / 2, float(rng.uniform(-np.pi, np.pi)))
        ends = [at(root, k * place, 0.0)[:2, 3] for place in PILLARS_AT]
        if not all(inside(site, xy, k * PILLAR[0]) for xy in ends) or not inside(
            site, start[:2, 3], k * RING[0]
        ):
            return None
        if not in_reach(site, start[:2, 3], (0.011, 0.1)):
            return None
        top = k * PILLAR[2]
        return (root, start) if all(in_reach(site, xy, (top - 0.03, top + 0.06)) for xy in ends) else None


TIP_ROOM = 0.0015
"""The fingertips' end stays so far above the table, metres."""

PALM_ROOM = 0.006
LIFT = 0.18


def slip_over(pillar: str, height: float, side: float, thickness: float, others: Sequence[str]) -> Solution:
    """Put the square body ``ring`` (outer ``side``, metres) over the body ``pillar`` of that ``height``."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        ring, post = world.pose("ring"), world.pose(pillar)
        near = {"ring", "table", *others}
        top = post[:3, 3] + UP * height / 2
        palm = arm.hand.finger_length - arm.hand.tip_beyond_tcp
        ways = []
        for hand_closing in (sign * ring[:3, i] for i in (0, 1) for sign in (1.0, -1.0)):
            lowest = ring[:3, 3] - UP * (thickness / 2 - TIP_ROOM - arm.hand.tip_beyond_tcp)
            grasp = rigid(grasp_rotation(DOWN, hand_closing), lowest)
            for over_closing in (sign * post[:3, i] for i in (0, 1) for sign in (1.0, -1.0)):
                over = rigid(grasp_rotation(DOWN, over_closing), top + UP * (palm + PALM_ROOM))
                ways.append((grasp, over))
        grasp, over = ways[best_path(arm, [[raised(g, 0.06), g, raised(g, LIFT)] for g, _ in ways])]
        reachable = [o for g, o in ways if g is grasp]
        over = reachable[best_path(arm, [[raised(o, 0.05), o] for o in reachable])]
        yield [
            *through("approach", [raised(grasp, 0.06)], 1.0, free=True, contacts=near),
            *through("reach", [grasp], 1.0, speed=0.08, contacts=near),
            *through("grasp", [grasp], 0.0, contacts=near),
            *through("lift", [raised(grasp, LIFT)], 0.0, contacts=near, carries="ring"),
            *through("carry", [raised(over, 0.05)], 0.0, free=True, contacts=near, carries="ring"),
        ]
        # How the ring lies in the hand now: bring its middle, not the hand's, over the pillar.
        hand = raised(over, 0.05)
        tool_from_ring = invert_rigid(hand) @ world.pose("ring")
        over = _centred(over, tool_from_ring, top)
        yield [
            *through("align", [raised(over, 0.05)], 0.0, speed=0.05, contacts=near, tolerance=0.003),
            *through("insert", [over], 0.0, speed=0.05, contacts=near),
            *through("release", [over], 0.8, contacts=near),
            *through("leave", [raised(over, 0.06)], 0.8, contacts=near),
        ]

    return solve


def _centred(over: FloatArray, tool_from_ring: FloatArray, axis: FloatArray) -> FloatArray:
    """The tool pose (4, 4) moved sideways until the ring's middle is on the vertical through ``axis`` (3,)."""
    off = (over @ tool_from_ring)[:3, 3] - axis
    return rigid(translation=(-float(off[0]), -float(off[1]), 0.0)) @ over
