"""Put a block on a square that is painted on the table."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import at, in_reach, inside, sample_root, sample_until
from gvla2.robot.solids import Volume, on
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import put_on
from gvla2_plugins.tabletop.scenes import lifted, sample_colours, sentence_of, square

SIZE, MASS = 0.0608, 0.448
BLOCK_AT, TARGET_AT = (0.025, -0.025), (0.025, 0.15)
TARGET, EASED_AREA, STRICT_AREA = 0.173, 0.17, 0.01
"""Metres, kilograms; places in the root's frame; areas are squares about the target's centre."""

TOUCHING = 0.005
"""Height of the target area's volume, metres: a block that touches it is on the table, or all but."""


class PutBlock:
    """Put the block on the target. relaxed: it touches the target area. strict: its centre is within 1 cm²."""

    instructions = (
        "put the {colour} block on the {target} square",
        "pick up the {colour} cube and place it on the {target} target",
        "place the {colour} block onto the {target} patch on the table",
        "set the {colour} cube down on the {target} square",
        "could you put the {colour} cube on the {target} square?",
    )
    """Paraphrases; ``{colour}`` is the block's colour, ``{target}`` the square's."""

    def __init__(self, config: ScaledConfig) -> None:
        self._size = SIZE * config.factor("put_block")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one block and one target, whatever ``instruction`` says."""
        root = sample_until(lambda: self._draw_root(rng, site), "a block and its target")
        block_colour, target_colour = sample_colours(rng, site, 2)
        size = self._size
        cube = Primitive("box", (size, size, size), COLOURS[block_colour])
        block = Body("block", (cube,), at(root, *BLOCK_AT, size / 2), MASS, label=f"{block_colour} cube")
        spot = at(root, *TARGET_AT)
        target = square(spot, TARGET, target_colour)
        area = on(spot, (EASED_AREA, EASED_AREA), TOUCHING)
        centre = Volume(spot @ lifted(size / 2), (STRICT_AREA, STRICT_AREA, size))

        def relaxed(world: WorldState) -> bool:
            return area.meets(block, world.pose("block"))

        def strict(world: WorldState) -> bool:
            return centre.holds(world.pose("block")[:3, 3])

        words = {"colour": block_colour, "target": target_colour}
        return TaskInstance(
            Layout((block, target)),
            sentence_of(rng, self.instructions, instruction, **words),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the {block_colour} block touches the {target_colour} square; strict: its centre is within "
            f"{STRICT_AREA / 2 * 1000:g} mm of the square's, along both sides",
            solution=put_on("block", "target", np.full(3, size)),
        )

    def _draw_root(self, rng: np.random.Generator, site: TaskSite) -> FloatArray | None:
        root = sample_root(rng, site)
        block, target = at(root, *BLOCK_AT)[:2, 3], at(root, *TARGET_AT)[:2, 3]
        if not inside(site, block, self._size / np.sqrt(2)) or not inside(site, target, TARGET / np.sqrt(2)):
            return None
        return root if all(in_reach(site, xy, (self._size / 2, 0.2)) for xy in (block, target)) else None
