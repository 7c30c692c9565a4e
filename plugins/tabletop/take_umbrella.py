"""Pull a folded umbrella out of its stand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.placing import in_reach, inside, sample_root, sample_until
from gvla2.robot.solids import Volume, tray
from gvla2.robot.task import Body, Layout, Primitive, Solution, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import UP, around, best_closing, pick
from gvla2_plugins.tabletop.scenes import lifted, sample_colours, sentence_of

STAND, WALL = (0.10, 0.10, 0.20), 0.005
HANDLE_AT, HANDLE = 0.257, (0.024, 0.024, 0.060)
FOLDS, SHAFT = 0.056, 0.012
VOLUME = (0.08, 0.08, 0.10)
MASS = 0.15
"""Metres and kilograms. The umbrella stands on its flat end in the stand, its handle's middle at ``HANDLE_AT``."""

STAND_RGB, SHAFT_RGB = (0.30, 0.30, 0.32), (0.75, 0.75, 0.75)


class TakeUmbrella:
    """Take the umbrella out. Both profiles: no part of it is in the upper half of the stand any more."""

    instructions = (
        "take the umbrella out of the stand",
        "pull the {colour} umbrella out of the umbrella stand",
        "lift the umbrella out of its holder",
        "remove the {colour} umbrella from the stand",
        "grab the umbrella by its handle and pull it out",
    )
    """Paraphrases; ``{colour}`` is the umbrella's colour."""

    def __init__(self, config: ScaledConfig) -> None:
        self._scale = config.factor("take_umbrella")

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one umbrella, whatever ``instruction`` says."""
        k = self._scale
        root = sample_until(lambda: self._draw(rng, site), "an umbrella stand")
        (colour,) = sample_colours(rng, site, 1, beside=(STAND_RGB, SHAFT_RGB))
        x, y, z = (k * side for side in STAND)
        stand = Body(
            "stand",
            tray((x, y, z), WALL, STAND_RGB),
            root,
            fixed=True,
            label="gray umbrella stand",
            shape="box",
        )
        umbrella = Body(
            "umbrella",
            _umbrella(k, COLOURS[colour]),
            root @ lifted(WALL),
            MASS,
            label=f"{colour} umbrella",
            shape="cylinder",
            parts=(("handle", (2,)),),
        )
        volume = Volume(root @ lifted(0.75 * z), (k * VOLUME[0], k * VOLUME[1], z / 2))

        def done(world: WorldState) -> bool:
            return not volume.meets(umbrella, world.pose("umbrella"))

        return TaskInstance(
            Layout((stand, umbrella)),
            sentence_of(rng, self.instructions, instruction, colour=colour),
            {"relaxed": done, "strict": done},
            f"the {colour} umbrella has left the stand",
            solution=pulllifted("umbrella", k * HANDLE_AT + 0.01, z + 0.01, contacts=("stand",)),
        )

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> FloatArray | None:
        root, handle = sample_root(rng, site), self._scale * HANDLE_AT
        if not inside(site, root[:2, 3], self._scale * STAND[0] / np.sqrt(2)):
            return None
        return root if in_reach(site, root[:2, 3], (handle, handle + 0.12, handle + 0.26)) else None


def _umbrella(k: float, rgb: tuple[float, float, float]) -> tuple[Primitive, ...]:
    """Folds, shaft and handle of a folded umbrella that stands on z = 0, ``k`` times its size; metres."""
    low, high = k * (HANDLE_AT - HANDLE[2] / 2) - WALL, k * (HANDLE_AT + HANDLE[2] / 2) - WALL
    folds = 0.85 * low
    return (
        Primitive("cylinder", (k * FOLDS, k * FOLDS, folds), rgb, lifted(folds / 2)),
        Primitive("cylinder", (k * SHAFT, k * SHAFT, low - folds), SHAFT_RGB, lifted((folds + low) / 2)),
        Primitive("cylinder", (k * HANDLE[0], k * HANDLE[1], high - low), rgb, lifted((low + high) / 2)),
    )


def pulllifted(obj: str, height: float, lift: float, contacts: Sequence[str] = ()) -> Solution:
    """Grasp an upright ``obj`` from above at ``height`` over its origin and lift it by ``lift``; metres."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(obj)
        grasp = transform_points(pose, (0.0, 0.0, height))
        closing = best_closing(arm, [grasp, grasp + UP * lift], around(UP, pose[:3, 0], 8))
        yield pick(obj, grasp, closing, lift, contacts=contacts, standoff=0.08)

    return solve
