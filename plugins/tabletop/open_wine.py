"""Turn the cap of a wine bottle until it comes off."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.robot.placing import in_reach, inside, sample_root, sample_until
from gvla2.robot.solids import Volume
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, Thread, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.scenes import lifted, sentence_of
from gvla2_plugins.tabletop.screws import unscrew

BOTTLE, NECK = (0.074, 0.20), 0.022
CAP, CAP_AT, CAP_MASS = (0.028, 0.028, 0.008), 0.29, 0.01
RELEASE = np.deg2rad(150.0)
LEFT_RADIUS, LEFT_HEIGHT = 0.015, 0.03
"""Metres, kilograms, radians. The cap turns by pi either way; the volume that it leaves is about its place."""

GLASS, GOLD = (0.05, 0.25, 0.12), (0.95, 0.75, 0.10)
IMAGE_SIZE = 512


class OpenWine:
    """Take the cap off the bottle. Both profiles: it was turned by 150 degrees, and has left its place."""

    instructions = (
        "open the wine bottle",
        "unscrew the cap of the wine bottle",
        "twist the cap off the bottle and lift it",
        "take the yellow cap off the wine bottle",
        "please uncap the wine",
    )
    """Paraphrases."""

    def __init__(self, config: ScaledConfig) -> None:
        self._scale = config.factor("open_wine")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one bottle, whatever ``instruction`` says."""
        k = self._scale
        root = sample_until(lambda: self._draw(rng, site), "a wine bottle")
        neck_top = k * (CAP_AT - CAP[2] / 2)
        glass = (
            _round(k * BOTTLE[0], 0.0, k * BOTTLE[1]),
            _round(k * (BOTTLE[0] + NECK) / 2, k * BOTTLE[1], k * (BOTTLE[1] + 0.02)),
            _round(k * NECK, k * (BOTTLE[1] + 0.02), neck_top),
        )
        x, y, z = (k * side for side in CAP)
        cap = Body(
            "cap", (Primitive("box", (x, y, z), GOLD),), root @ lifted(neck_top + z / 2), CAP_MASS,
            label="yellow cap", shape="disc",
        )  # fmt: skip
        bottle = Body("bottle", glass, root, 1.2, fixed=True, label="green wine bottle", shape="cylinder")
        thread = Thread(
            "thread",
            "bottle",
            "cap",
            np.array([0.0, 0.0, 1.0]),
            cap.world_from_body[:3, 3],
            RELEASE,
            (-np.pi, np.pi),
        )
        about = Volume(
            cap.world_from_body, (2 * k * LEFT_RADIUS, 2 * k * LEFT_RADIUS, k * LEFT_HEIGHT), round=True
        )

        def done(world: WorldState) -> bool:
            return world.loose("thread") and not about.meets(cap, world.pose("cap"))

        return TaskInstance(
            Layout((bottle, cap), threads=(thread,)),
            sentence_of(rng, self.instructions, instruction),
            {"relaxed": done, "strict": done},
            "the cap was turned by 150 degrees and has left the bottle's mouth",
            image_size=IMAGE_SIZE,
            solution=unscrew(
                "cap",
                "bottle",
                turns=(np.deg2rad(165.0), -np.deg2rad(165.0)),
                depth=0.3 * z,
                lift=0.06,
                square=True,
            ),
        )

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> FloatArray | None:
        root, top = sample_root(rng, site), self._scale * CAP_AT
        if not inside(site, root[:2, 3], self._scale * BOTTLE[0] / 2):
            return None
        return root if in_reach(site, root[:2, 3], (top, top + 0.14)) else None


def _round(diameter: float, low: float, high: float) -> Primitive:
    middle = lifted((low + high) / 2)
    return Primitive("cylinder", (diameter, diameter, high - low), GLASS, middle)
