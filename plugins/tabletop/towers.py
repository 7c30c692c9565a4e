"""Pull a loose brick out of a tower of bricks; slip a square ring over one of three pillars."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.solids import Volume, at, sample_until, square_ring
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import DOWN, PAINT, Draw, TabletopTask, box, scaled

BRICK, MASS = (0.2, 0.067, 0.033), 0.448
LOOSE = 0.9
"""The loose brick's scale; its mass goes with the cube: 0.327 kg."""

LAYERS, LAYER, SLOT = 5, 3, 1
"""Layers of three bricks, and the loose one's place among them: its middle is 0.114 m above the table."""

STICKS_OUT = 0.06
GOAL, GOAL_RADIUS, GOAL_HEIGHT = (0.225, 0.2), 0.05, 0.2
YAW = np.pi / 8
"""Metres; the goal is an upright cylinder over a painted circle, in the root's frame. The brick sticks out to +y."""

STAYED = 0.03
"""How far a brick may be from where it was and still count as standing, metres: half of one's breadth."""

WOOD = (0.93, 0.91, 0.86)


class PlayJenga(TabletopTask[ScaledConfig]):
    """Take the loose brick out of the tower. relaxed: some part of it is in the goal's cylinder. strict: the same,
    released, while all others still stand in place.
    """

    name = "play_jenga"
    instructions = (
        "pull the {colour} block out of the jenga tower and put it on the {target} circle",
        "take the protruding {colour} brick out of the tower and lay it on the {target} circle",
        "play jenga: remove the {colour} block without toppling the tower, and put it on the {target} circle",
        "slide the {colour} block that sticks out of the stack out of it and onto the {target} circle",
        "grab the {colour} jenga block, pull it out and set it down on the {target} circle",
    )

    def lay_out(self, draw: Draw) -> TaskInstance:
        """A tower of bricks with one that sticks out."""
        k = self.scale
        root = sample_until(lambda: self._root(draw), "a tower of bricks")
        colour, circle = draw.colours(2, beside=(WOOD,))
        bricks = []
        for layer, slot in np.ndindex(LAYERS, 3):
            if (layer, slot) == (LAYER, SLOT):
                bricks.append(self._loose(root, colour))
                continue
            across, crosswise = k * (slot - 1) * BRICK[1], layer % 2 == 1
            spot = (across, 0.0) if crosswise else (0.0, across)
            pose = at(root, spot[0], spot[1], k * (layer + 0.5) * BRICK[2], np.pi / 2 if crosswise else 0.0)
            solid = box(scaled(k, BRICK), WOOD)
            bricks.append(Body(f"brick_{layer}_{slot}", (solid,), pose, MASS, label="white brick"))
        wide, height = 2 * GOAL_RADIUS, k * GOAL_HEIGHT
        paint = Primitive("cylinder", (wide, wide, PAINT), COLOURS[circle], collides=False)
        patch = Body("circle", (paint,), at(root, *GOAL, PAINT / 2), fixed=True, label=f"{circle} circle")
        layout = Layout((*bricks, patch))
        goal = Volume(at(root, *GOAL, height / 2), (wide, wide, height), round=True)

        def relaxed(world: WorldState) -> bool:
            return goal.meets(layout["loose"], world.pose("loose"))

        def strict(world: WorldState) -> bool:
            others = [b for b in bricks if b.name != "loose"]
            moved = [np.linalg.norm(world.pose(b.name)[:3, 3] - b.world_from_body[:3, 3]) for b in others]
            return bool(relaxed(world) and world.resting("loose") and max(moved) < k * STAYED)

        return draw.instance(
            layout,
            relaxed,
            strict,
            f"relaxed: the {colour} brick is over the {circle} circle; strict: let go of, and the others stand",
            colour=colour,
            target=circle,
        )

    def _loose(self, root: FloatArray, colour: str) -> Body:
        k = self.scale
        size = scaled(k * LOOSE, BRICK)
        middle = k * (BRICK[0] / 2 + STICKS_OUT) - size[0] / 2
        pose = at(root, 0.0, middle, k * LAYER * BRICK[2] + size[2] / 2, np.pi / 2)
        return Body("loose", (box(size, COLOURS[colour]),), pose, MASS * LOOSE**3, label=f"{colour} brick")

    def _root(self, draw: Draw) -> FloatArray | None:
        root, k = draw.root(YAW), self.scale
        end = at(root, 0.0, k * (BRICK[0] / 2 + STICKS_OUT))[:2, 3]
        if not draw.site.inside(root[:2, 3], k * BRICK[0] / np.sqrt(2)) or not draw.site.inside(end, 0.03):
            return None
        if not draw.site.inside(at(root, *GOAL)[:2, 3], GOAL_RADIUS):
            return None
        paths = brick_paths(root, self._loose(root, "red").world_from_body, k)
        return root if any(map(draw.site.follows, paths)) else None


FROM_END = 0.02
"""Distance of the grasp from the brick's end, metres: the palm stays clear of the tower."""

DRAWN, CLEAR = 0.20, 0.06


def brick_paths(root: FloatArray, brick: FloatArray, scale: float) -> list[list[FloatArray]]:
    """Six tool poses (4, 4) each, the hand either way round: above the brick's end, at it, drawn out, aside, set down,
    above again.

    ``brick`` (4, 4), its x axis pointing out of the tower.
    """
    out, across = brick[:3, 0], root[:3, 0]
    turned = grasp_rotation(DOWN, brick[:3, 1])
    grasp = brick[:3, 3] + out * (scale * LOOSE * BRICK[0] / 2 - FROM_END)
    drawn = grasp + out * scale * DRAWN
    # The brick's middle comes over the goal.
    goal = root[:3, 3] + root[:3, :2] @ np.asarray(GOAL)
    aside = drawn + across * float((goal - drawn) @ across)
    down = goal + (grasp - brick[:3, 3])
    down[2] = root[2, 3] + scale * LOOSE * BRICK[2] / 2 + 0.003
    points = [grasp - CLEAR * DOWN, grasp, drawn, aside, down, down - CLEAR * DOWN]
    return [[rigid(turned @ np.diag([s, s, 1.0]), point) for point in points] for s in (1.0, -1.0)]


PILLAR, PILLARS_AT = (0.025, 0.025, 0.12), (-0.125, 0.0, 0.125)
RING, HOLE, RING_MASS = (0.05, 0.05, 0.01), 0.03, 0.02
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
        root, start = sample_until(lambda: self._poses(draw), "a ring and three pillars")
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
        ring = Body(
            "ring", walls, start, RING_MASS, friction=SMOOTH, label=f"{ring_colour} ring", shape="ring"
        )
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
        if not all(draw.site.inside(xy, k * PILLAR[0]) for xy in ends):
            return None
        if not draw.site.inside(start[:2, 3], k * RING[0]) or not draw.site.in_reach(
            start[:2, 3], 0.011, 0.1
        ):
            return None
        top = k * PILLAR[2]
        return (root, start) if all(draw.site.in_reach(xy, top - 0.03, top + 0.06) for xy in ends) else None
