"""Close a box whose lid hangs open behind it."""

from __future__ import annotations

import numpy as np

from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import sample_until
from gvla2.robot.task import Layout, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.boxes import TRAVEL, LidBox, draw_box, shut_paths
from gvla2_plugins.tabletop.demonstrations.lids import FALLS, push_shut
from gvla2_plugins.tabletop.painting import sample_colours
from gvla2_plugins.tabletop.wording import sentence_of

EASED, STRICT = 2.4, 2.6
"""Travel of the lid that counts, radians out of 2.618."""


class CloseBox:
    """Close the box. relaxed: the lid has come 2.4 rad of its 2.618; strict: 2.6 rad."""

    instructions = (
        "close the box",
        "shut the lid of the {colour} box",
        "close the {colour} box's lid",
        "swing the lid over so that the box is closed",
        "please shut the box",
    )
    """Paraphrases; ``{colour}`` is the box's colour."""

    def __init__(self, config: ScaledConfig) -> None:
        self._scale = config.factor("close_box")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one box, whatever ``instruction`` says."""
        angles = np.linspace(TRAVEL, FALLS, 5)

        def draw() -> LidBox | None:
            box = draw_box(rng, site, self._scale)
            if box is None or not any(site.follows(way) for way in shut_paths(box, angles)):
                return None
            return box

        box = sample_until(draw, "an open box")
        colour, lid_colour = sample_colours(rng, site, 2)
        bodies = box.bodies(TRAVEL, (COLOURS[colour], COLOURS[lid_colour]), f"{colour} box")

        def relaxed(world: WorldState) -> bool:
            return world.joint("hinge") > EASED

        def strict(world: WorldState) -> bool:
            return world.joint("hinge") > STRICT

        return TaskInstance(
            Layout(bodies, (box.joint(opens=False),)),
            sentence_of(rng, self.instructions, instruction, colour=colour),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the lid has come {EASED} rad of its {TRAVEL:.3f}; strict: {STRICT} rad",
            solution=push_shut(box),
        )
