"""Switch a lamp on by its sprung button."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.placing import in_reach, inside, sample_root, sample_until
from gvla2.robot.task import (
    Body,
    Glow,
    Joint,
    Layout,
    Primitive,
    Solution,
    TaskInstance,
    TaskSite,
    WorldState,
)
from gvla2_plugins.tabletop import LampOnConfig
from gvla2_plugins.tabletop.moves import DOWN, UP, around, best_closing, stop
from gvla2_plugins.tabletop.scenes import lifted, sample_colours

EASED_TRAVEL, STRICT_TRAVEL = 0.003, 0.0075
"""Travel of the button that counts, metres."""

BASE = (0.16, 0.08, 0.010)
BUTTON_X, POST_X = -0.045, 0.045
POST = (0.014, 0.014, 0.055)
SHADE = (0.060, 0.060, 0.035)
"""The lamp, metres. It stays below the hand's palm when the fingers press the button, so that any yaw of the hand
has room."""

BASE_RGB, POST_RGB, SHADE_RGB = (0.16, 0.16, 0.18), (0.20, 0.20, 0.22), (0.28, 0.27, 0.26)

SHADE_SOLID, LIT_RGB = 2, (1.0, 0.93, 0.62)
"""Which solid of the lamp shines when it is on, and how."""

PRELOAD = 0.002
"""How far beyond its stop the spring rests, metres: the button carries its own weight without sinking."""


class LampOn:
    """Press the button of a lamp. Success is the largest travel of the button, since a spring brings it back.

    relaxed: more than 3 mm. strict: more than 7.5 mm, of 10 mm.
    """

    instructions = (
        "turn on the lamp",
        "press the {colour} button to switch the lamp on",
        "push the {colour} button of the lamp",
        "switch the light on by pressing the {colour} button",
        "press the lamp's button",
    )
    """Paraphrases; ``{colour}`` is the button's colour."""

    def __init__(self, config: LampOnConfig) -> None:
        if not 0 < config.travel < config.height - BASE[2] or config.diameter <= 0 or config.stiffness <= 0:
            raise ConfigurationError(
                f"task=lamp_on needs a button that stands out of its base ({BASE[2]} m) by more than its travel, "
                f"got height={config.height}, travel={config.travel}, diameter={config.diameter}, "
                f"stiffness={config.stiffness}."
            )
        self._config = replace(config, diameter=config.diameter * config.factor("lamp_on"))

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one button, whatever ``instruction`` says."""
        root = sample_until(lambda: self._draw_root(rng, site), "a lamp")
        (colour,) = sample_colours(rng, site, 1, beside=(BASE_RGB, POST_RGB, SHADE_RGB))
        sentence = self.instructions[int(rng.integers(len(self.instructions)))].format(colour=colour)
        travel, height = self._config.travel, self._config.height - BASE[2]
        post_top = BASE[2] + POST[2]
        lamp = Body(
            "lamp",
            (
                Primitive("box", BASE, BASE_RGB, lifted(BASE[2] / 2, 0.0)),
                Primitive("cylinder", POST, POST_RGB, lifted(BASE[2] + POST[2] / 2, POST_X)),
                Primitive("cylinder", SHADE, SHADE_RGB, lifted(post_top + SHADE[2] / 2, POST_X)),
            ),
            root,
            mass=0.5,
            fixed=True,
        )
        diameter = self._config.diameter
        centre = root @ lifted(BASE[2] + height / 2, BUTTON_X)
        plate = Primitive("cylinder", (diameter, diameter, height), COLOURS[colour])
        button = Body("button", (plate,), centre, mass=0.02, label=f"{colour} button")
        slide = Joint(
            "press",
            "prismatic",
            parent="lamp",
            child="button",
            axis=np.array([0.0, 0.0, -1.0]),
            origin=centre[:3, 3],
            limits=(0.0, travel),
            rest=-PRELOAD,
            stiffness=self._config.stiffness,
            damping=4.0,
        )

        def relaxed(world: WorldState) -> bool:
            return world.peak("press") > EASED_TRAVEL

        def strict(world: WorldState) -> bool:
            return world.peak("press") > STRICT_TRAVEL

        return TaskInstance(
            Layout((lamp, button), (slide,), (Glow("lamp", SHADE_SOLID, "press", STRICT_TRAVEL, LIT_RGB),)),
            sentence if instruction is None else instruction,
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the button went down by more than {EASED_TRAVEL * 1000:g} mm; "
            f"strict: by more than {STRICT_TRAVEL * 1000:g} mm",
            solution=press("button", "lamp", height / 2, travel),
        )

    def _draw_root(self, rng: np.random.Generator, site: TaskSite) -> FloatArray | None:
        """Pose (4, 4) of the middle of the base's underside; None when it is out of place."""
        root = sample_root(rng, site)
        button = transform_points(root, (BUTTON_X, 0.0, 0.0))[:2]
        if not inside(site, root[:2, 3], 0.5 * float(np.hypot(BASE[0], BASE[1]))):
            return None
        return root if in_reach(site, button, (0.01, self._config.height + 0.15)) else None


def press(button: str, beside: str, top: float, travel: float) -> Solution:
    """Press the body ``button``, whose upper face is ``top`` over its origin, down by ``travel``; metres."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(button)
        face = transform_points(pose, (0.0, 0.0, top)) + UP * arm.hand.tip_beyond_tcp
        down = face - UP * travel
        closing = best_closing(arm, [face + 0.06 * UP, down], around(UP, pose[:3, 0], 8))
        near = {button, beside, "table"}
        yield [
            stop("approach", face + 0.06 * UP, 0.0, DOWN, closing, free=True, contacts=near),
            stop("press", down, 0.0, speed=0.05, contacts=near),
            stop("leave", face + 0.06 * UP, 0.0, contacts=near),
        ]

    return solve
