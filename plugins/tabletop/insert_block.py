"""Slip a square ring over one of three pillars, which is named by its colour."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.placing import at
from gvla2.robot.solids import square_ring
from gvla2.robot.task import Body, Layout, Solution, TaskInstance, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import DOWN, UP, best_path, both, let_go, raised, take, through
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
            slip_over(pillar.name, size[2], outer[2], [p.name for p in pillars]),
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


TIP_ROOM = 0.0015
"""The fingertips' end stays so far above the table, metres."""

PALM_ROOM = 0.006
LIFT = 0.18


def slip_over(pillar: str, height: float, thickness: float, others: Sequence[str]) -> Solution:
    """Put the square body ``ring`` of that ``thickness`` over the body ``pillar`` of that ``height``, metres."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        ring, post = world.pose("ring"), world.pose(pillar)
        near = {"ring", "table", *others}
        top = post[:3, 3] + UP * height / 2
        palm = arm.hand.finger_length - arm.hand.tip_beyond_tcp
        lowest = ring[:3, 3] - UP * (thickness / 2 - TIP_ROOM - arm.hand.tip_beyond_tcp)
        grasps = [rigid(grasp_rotation(DOWN, side), lowest) for side in both(ring[:3, 0], ring[:3, 1])]
        grasp = grasps[best_path(arm, [[raised(g, 0.06), g, raised(g, LIFT)] for g in grasps])]
        spot = top + UP * (palm + PALM_ROOM)
        overs = [rigid(grasp_rotation(DOWN, side), spot) for side in both(post[:3, 0], post[:3, 1])]
        over = overs[best_path(arm, [[raised(o, 0.05), o] for o in overs])]
        yield [
            *take(raised(grasp, 0.06), grasp, 1.0, near, speed=0.08),
            *through("lift", [raised(grasp, LIFT)], 0.0, contacts=near, carries="ring"),
            *through("carry", [raised(over, 0.05)], 0.0, free=True, contacts=near, carries="ring"),
        ]
        # How the ring lies in the hand now: bring its middle, not the hand's, over the pillar.
        tool_from_ring = invert_rigid(raised(over, 0.05)) @ world.pose("ring")
        off = (over @ tool_from_ring)[:2, 3] - top[:2]
        over = rigid(translation=(-off[0], -off[1], 0.0)) @ over
        yield [
            *through("align", [raised(over, 0.05)], 0.0, speed=0.05, contacts=near, tolerance=0.003),
            *through("insert", [over], 0.0, speed=0.05, contacts=near),
            *let_go(over, raised(over, 0.06), 0.8, near),
        ]

    return solve
