"""Move a spray bottle onto a painted square."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.solids import on
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import put_on
from gvla2_plugins.tabletop.scenes import lifted, sample_colours, sentence_of, square

TANK, NECK, HEAD = (0.066, 0.12), (0.028, 0.03), (0.075, 0.026, 0.032)
MASS = 0.25
TARGET, STRICT_AREA, DISTANCE = 0.13, 0.04, (0.20, 0.40)
"""Metres, kilograms: diameter and height of tank and neck, sides of the head that sprays to its +x."""

UPRIGHT = np.cos(np.deg2rad(15.0))
LOW = 0.02
"""A bottle stands when it is within 15 degrees of upright and its base no higher than this, metres."""

HEAD_RGB = (0.95, 0.95, 0.95)


class MoveSprayBottle:
    """Move the bottle to the square. relaxed: it stands with its middle over the square. strict: within 2 cm of the
    square's middle along both sides, let go of.
    """

    instructions = (
        "move the spray bottle to the {target} square",
        "pick up the {colour} spray bottle and put it on the {target} square",
        "place the {colour} bottle on the {target} patch",
        "take the spray bottle and set it down on the {target} square",
        "put the {colour} spray bottle onto the {target} target",
    )
    """Paraphrases; ``{colour}`` is the bottle's colour, ``{target}`` the square's."""

    def __init__(self, config: ScaledConfig) -> None:
        self._scale = config.factor("move_spray_bottle")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one bottle and one square, whatever ``instruction`` says."""
        start, spot = sample_until(lambda: self._draw(rng, site), "a spray bottle and its square")
        colour, target_colour = sample_colours(rng, site, 2, beside=(HEAD_RGB,))
        words = f"{colour} spray bottle"
        bottle = Body("bottle", self._solids(COLOURS[colour]), start, MASS, label=words, shape="cylinder")
        target = square(spot, TARGET, target_colour)
        area = on(spot @ lifted(-LOW), (TARGET, TARGET), 2 * LOW)
        middle = on(spot @ lifted(-LOW), (STRICT_AREA, STRICT_AREA), 2 * LOW)

        def relaxed(world: WorldState) -> bool:
            pose = world.pose("bottle")
            return bool(pose[2, 2] > UPRIGHT) and area.holds(pose[:3, 3])

        def strict(world: WorldState) -> bool:
            return relaxed(world) and middle.holds(world.pose("bottle")[:3, 3]) and world.resting("bottle")

        size = self._scale * np.array([0.10, HEAD[1], TANK[1] + NECK[1] + HEAD[2]])
        return TaskInstance(
            Layout((bottle, target)),
            sentence_of(rng, self.instructions, instruction, colour=colour, target=target_colour),
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the bottle stands on the {target_colour} square; strict: in its middle, let go of",
            solution=put_on("bottle", "target", size, base=True, depth=0.02),
        )

    def _solids(self, rgb: tuple[float, float, float]) -> tuple[Primitive, ...]:
        k = self._scale
        (tank, high), (neck, middle), head = TANK, NECK, HEAD
        return (
            Primitive("cylinder", (k * tank, k * tank, k * high), rgb, lifted(k * high / 2)),
            Primitive("cylinder", (k * neck, k * neck, k * middle), rgb, lifted(k * (high + middle / 2))),
            Primitive(
                "box", (k * head[0], k * head[1], k * head[2]), HEAD_RGB,
                rigid(translation=(k * 0.012, 0.0, k * (high + middle + head[2] / 2))),
            ),
        )  # fmt: skip

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> tuple[FloatArray, FloatArray] | None:
        root, height = sample_root(rng, site), self._scale * (TANK[1] + NECK[1])
        direction, yaw, distance = (
            rng.uniform(-np.pi, np.pi),
            rng.uniform(-np.pi, np.pi),
            rng.uniform(*DISTANCE),
        )
        goal = root[:2, 3] + distance * np.array([np.cos(direction), np.sin(direction)])
        if not inside(site, root[:2, 3], 0.05) or not inside(site, goal, TARGET / np.sqrt(2)):
            return None
        if not all(in_reach(site, xy, (height, height + 0.18)) for xy in (root[:2, 3], goal)):
            return None
        return root, planar(goal, site.table_height, float(yaw))
