"""Put the mustard bottle, out of three items, into the tray."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.robot.placing import clear, in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.solids import on, tray
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import put_on
from gvla2_plugins.tabletop.scenes import lifted, sentence_of

TRAY, TRAY_WALL = (0.318, 0.318, 0.05), 0.008
VOLUME = (0.325, 0.325, 0.10)
BOTTLE, SHOULDERS, MASS = (0.10, 0.06, 0.19), 0.17, 0.30
CAN, CARTON = (0.066, 0.066, 0.10), (0.09, 0.05, 0.13)
"""Metres and kilograms; the bottle is as deep as ``SHOULDERS`` and narrows to its nozzle above."""

YELLOW, RED, BLUE, GREEN, GREY = (
    (1.0, 0.85, 0.0),
    (0.8, 0.0, 0.0),
    (0.0, 0.2, 0.8),
    (0.0, 0.5, 0.0),
    (0.4,) * 3,
)

GRASP_DEPTH = 0.034
"""How far below the nozzle's end the hand can grasp before its palm is on it, metres."""

MOST_SPAN = 0.074
"""The hand opens 0.08 m."""


class SortMustard:
    """Put the mustard bottle into the tray. Both profiles: it rests in a volume of 10 cm over the tray."""

    instructions = (
        "put the mustard bottle in the tray",
        "place the yellow mustard into the gray tray",
        "pick up the yellow bottle and put it in the tray",
        "sort the mustard into the tray",
        "move the yellow mustard bottle into the tray, please",
    )
    """Paraphrases."""

    def __init__(self, config: ScaledConfig) -> None:
        scale = config.factor("sort_mustard")
        length, width, height = (scale * side for side in BOTTLE)
        self._bottle = (length, min(width, MOST_SPAN), height)
        self._shoulders = SHOULDERS * scale

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; only the bottle is asked for, whatever ``instruction`` says."""
        poses = sample_until(lambda: self._draw(rng, site), "a tray and three items")
        bottle = Body(
            "bottle", _bottle(self._bottle, self._shoulders), poses[1], MASS, label="yellow mustard bottle",
            shape="box",
        )  # fmt: skip
        container = Body("tray", tray(TRAY, TRAY_WALL, GREY), poses[0], fixed=True, label="gray tray")
        can = Body(
            "can", (Primitive("cylinder", CAN, BLUE, lifted(CAN[2] / 2)),), poses[2], 0.2, label="blue can"
        )
        carton = Body(
            "carton",
            (Primitive("box", CARTON, GREEN, lifted(CARTON[2] / 2)),),
            poses[3],
            0.2,
            label="green carton",
        )
        volume = on(poses[0], VOLUME[:2], VOLUME[2])

        def done(world: WorldState) -> bool:
            return volume.meets(bottle, world.pose("bottle")) and world.resting("bottle")

        return TaskInstance(
            Layout((container, bottle, can, carton)),
            sentence_of(rng, self.instructions, instruction),
            {"relaxed": done, "strict": done},
            "the mustard bottle rests in the tray, let go of",
            solution=put_on(
                "bottle", "tray", np.asarray(self._bottle), base=True, rise=TRAY_WALL, lift=0.10,
                depth=GRASP_DEPTH,
            ),
        )  # fmt: skip

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> list[FloatArray] | None:
        """Poses (4, 4) of the undersides of tray, bottle, can and carton."""
        root = sample_root(rng, site)
        spots = np.vstack([root[:2, 3], [sample_root(rng, site)[:2, 3] for _ in range(3)]])
        yaws = rng.uniform(-np.pi, np.pi, size=3)
        radii = [
            TRAY[0] / np.sqrt(2),
            float(np.hypot(*self._bottle[:2])) / 2,
            CAN[0] / 2,
            float(np.hypot(*CARTON[:2])) / 2,
        ]
        if not clear(spots, radii, 0.03) or not all(
            inside(site, xy, radius) for xy, radius in zip(spots[1:], radii[1:], strict=True)
        ):
            return None
        if not inside(site, spots[0], TRAY[0] / 2):
            return None
        grasp = self._bottle[2] - GRASP_DEPTH
        if not in_reach(site, spots[1], (grasp, grasp + 0.12)) or not in_reach(
            site, spots[0], (grasp, grasp + 0.15)
        ):
            return None
        items = [planar(xy, site.table_height, float(y)) for xy, y in zip(spots[1:], yaws, strict=True)]
        return [root, *items]


def _bottle(size: tuple[float, float, float], shoulders: float) -> tuple[Primitive, ...]:
    """Body, shoulder and nozzle of a squeeze bottle that stands on z = 0."""
    length, width, height = size
    step = (height - shoulders) / 2
    cap, nozzle = 0.6 * width, 0.3 * width
    return (
        Primitive("box", (length, width, shoulders), YELLOW, lifted(shoulders / 2)),
        Primitive("cylinder", (cap, cap, step), YELLOW, lifted(shoulders + step / 2)),
        Primitive("cylinder", (nozzle, nozzle, step), RED, lifted(shoulders + 1.5 * step)),
    )
