"""Open a box: prise its lid up by the lip and swing it over."""

from __future__ import annotations

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import rigid
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import sample_until
from gvla2.robot.task import Layout, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import OpenBoxConfig
from gvla2_plugins.tabletop.boxes import TRAVEL, LidBox, draw_box, lip_path
from gvla2_plugins.tabletop.demonstrations.lids import LIP_REACH, STANDOFF, swing_open
from gvla2_plugins.tabletop.painting import sample_colours
from gvla2_plugins.tabletop.wording import sentence_of

OPEN = np.pi / 2
"""Travel of the lid that counts, radians."""


class OpenBox:
    """Open the box. relaxed: the lid was opened by more than a right angle at some time. strict: it still is."""

    instructions = (
        "open the box",
        "open the lid of the {colour} box",
        "lift the lid of the box until it stays open",
        "swing the {colour} box's lid open",
        "please open that box for me",
    )
    """Paraphrases; ``{colour}`` is the box's colour."""

    def __init__(self, config: OpenBoxConfig) -> None:
        if not 0.0 < config.swing <= TRAVEL:
            raise ConfigurationError(
                f"task=open_box takes task.swing above 0 and up to {TRAVEL:.2f} rad, got {config.swing}."
            )
        self._scale, self._swing = config.factor("open_box"), config.swing

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one box, whatever ``instruction`` says."""
        angles = np.linspace(0.0, self._swing, 6)

        def draw() -> LidBox | None:
            box = draw_box(rng, site, self._scale)
            if box is None:
                return None
            for sign in (1.0, -1.0):
                path = lip_path(box, angles, LIP_REACH, sign)
                if site.follows([path[0] @ rigid(translation=(0, 0, -STANDOFF)), *path]):
                    return box
            return None

        box = sample_until(draw, "a box")
        colour, lid_colour = sample_colours(rng, site, 2)
        bodies = box.bodies(0.0, (COLOURS[colour], COLOURS[lid_colour]), f"{colour} box")

        return TaskInstance(
            Layout(bodies, (box.joint(opens=True),)),
            sentence_of(rng, self.instructions, instruction, colour=colour),
            {"relaxed": _was_open, "strict": _is_open},
            "relaxed: the lid was opened by more than 90 degrees; strict: it still is",
            solution=swing_open(box),
        )


def _was_open(world: WorldState) -> bool:
    return world.peak("hinge") > OPEN


def _is_open(world: WorldState) -> bool:
    return world.joint("hinge") > OPEN
