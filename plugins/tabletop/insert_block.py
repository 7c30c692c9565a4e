"""Slip a square ring over one of three pillars, which is named by its colour."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import at
from gvla2.robot.solids import square_ring
from gvla2.robot.task import Body, Layout, TaskInstance, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import Draw, TabletopTask, box, scaled

PILLAR, PILLARS_AT = (0.025, 0.025, 0.12), (-0.125, 0.0, 0.125)
RING, HOLE, MASS = (0.05, 0.05, 0.01), 0.03, 0.02
SPAWN, SPAWN_AT = (0.40, 0.20), (0.0, -0.20)
"""Metres, kilograms, in the root's frame. The hole leaves 2.5 mm about the pillar."""

SMOOTH = 0.2
"""Friction of ring and pillars: a wooden ring on a lacquered pillar slides down by itself."""

LOW = 0.005
"""A ring is at the foot if it is at most this far above its flat position, metres."""


class InsertBlock(TabletopTask[ScaledConfig]):
    """Put the ring over the named pillar. relaxed: it lies about the pillar's foot. strict: the same, and released."""

    name = "insert_block"
    instructions = (
        "put the ring on the {colour} pillar",
        "slide the square ring over the {colour} peg",
        "insert the ring onto the {colour} pillar",
        "place the ring around the {colour} post",
        "drop the ring over the {colour} pillar",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A square ring and three pillars."""
        k = self.scale
        root, start = draw.until(lambda: self._poses(draw), "a ring and three pillars")
        ring_colour, *colours = draw.colours(4)
        own = int(draw.rng.integers(3))
        target, aside = draw.named(colours, own)
        size, outer = scaled(k, PILLAR), scaled(k, RING)
        pillars = []
        for i, (place, c) in enumerate(zip(PILLARS_AT, colours, strict=True)):
            pose, solid = at(root, k * place, 0.0, size[2] / 2), box(size, COLOURS[c])
            label = f"{c} pillar"
            pillars.append(Body(f"pillar_{i}", (solid,), pose, fixed=True, friction=SMOOTH, label=label))
        walls = square_ring(outer, k * (RING[0] - HOLE) / 2, COLOURS[ring_colour], -outer[2] / 2)
        ring = Body("ring", walls, start, MASS, friction=SMOOTH, label=f"{ring_colour} ring", shape="ring")
        pillar = pillars[target]
        room, foot = k * (HOLE - PILLAR[0]) / 2, draw.site.table_height + outer[2] / 2 + LOW

        def relaxed(world: WorldState) -> bool:
            middle = world.pose("ring")[:3, 3]
            off = transform_points(invert_rigid(pillar.world_from_body), middle)
            return bool(np.abs(off[:2]).max() < np.sqrt(2) * room and middle[2] < foot)

        return draw.instance(
            Layout((*pillars, ring)),
            relaxed,
            lambda world: relaxed(world) and world.resting("ring"),
            f"relaxed: the ring lies about the foot of the {colours[target]} pillar; strict: let go of, at rest{aside}",
            image_size=512,
            colour=colours[own],
        )

    def _poses(self, draw: Draw) -> tuple[FloatArray, FloatArray] | None:
        """The root's and the ring's pose (4, 4)."""
        k, root = self.scale, draw.root()
        half = 0.5 * np.asarray(SPAWN) - k * RING[0] / np.sqrt(2)
        x, y = np.asarray(SPAWN_AT) + draw.rng.uniform(-half, half)
        start = at(root, x, y, k * RING[2] / 2, draw.angle())
        ends = [at(root, k * place, 0.0)[:2, 3] for place in PILLARS_AT]
        if not all(draw.inside(xy, k * PILLAR[0]) for xy in ends):
            return None
        if not draw.inside(start[:2, 3], k * RING[0]) or not draw.in_reach(start[:2, 3], 0.011, 0.1):
            return None
        top = k * PILLAR[2]
        return (root, start) if all(draw.in_reach(xy, top - 0.03, top + 0.06) for xy in ends) else None
