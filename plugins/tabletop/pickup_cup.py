"""Pick a cup up by its rim: it is wider than the hand opens."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.placing import clear, in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.solids import cup, on
from gvla2.robot.task import Body, Layout, Solution, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import DOWN, UP, around, pick
from gvla2_plugins.tabletop.scenes import named_by_colour, sample_colours, sentence_of

DIAMETER, HEIGHT, WALL, MASS = 0.093, 0.147, 0.004, 0.053
AREA = (0.40, 0.60)
STOOD_IN = (0.05, 0.05, 0.025)
"""Metres and kilograms; the volume stands on the table where the cup stood."""

GAP = 0.10
"""Between the cups, metres: room for fingers and palm."""


class PickupCup:
    """Pick up the cup of the named colour, beside another. Both profiles: held, and out of the volume it stood in."""

    instructions = (
        "pick up the {colour} cup",
        "grab the {colour} mug and lift it",
        "lift the {colour} cup off the table",
        "take the {colour} cup by its rim and hold it up",
        "please raise the {colour} mug",
    )
    """Paraphrases; ``{colour}`` is the cup's colour."""

    def __init__(self, config: ScaledConfig) -> None:
        scale = config.factor("pickup_cup")
        self._diameter, self._height = DIAMETER * scale, HEIGHT * scale

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; a given ``instruction`` decides the cup if it names the colour of exactly one."""
        poses = sample_until(lambda: self._draw(rng, site), "two cups")
        colours = sample_colours(rng, site, 2)
        target, aside = named_by_colour(instruction, colours, 0)
        bodies = tuple(
            Body(
                f"cup_{i}",
                cup(self._diameter, self._height, WALL, COLOURS[colour]),
                pose,
                MASS,
                label=f"{colour} cup",
                shape="cylinder",
            )
            for i, (pose, colour) in enumerate(zip(poses, colours, strict=True))
        )
        body = bodies[target]
        volume = on(body.world_from_body, STOOD_IN[:2], STOOD_IN[2])

        def done(world: WorldState) -> bool:
            return world.held(body.name) and not volume.meets(body, world.pose(body.name))

        return TaskInstance(
            Layout(bodies),
            sentence_of(rng, self.instructions, instruction, colour=colours[0]),
            {"relaxed": done, "strict": done},
            f"the fingers hold the {colours[target]} cup, out of the place where it stood{aside}",
            solution=by_the_rim(body.name, self._diameter, self._height, WALL),
        )

    def _draw(self, rng: np.random.Generator, site: TaskSite) -> list[FloatArray] | None:
        """Poses (4, 4) of both cups' undersides."""
        root, radius = sample_root(rng, site), self._diameter / 2
        half = 0.5 * np.asarray(AREA) - radius
        spots = rng.uniform(-half, half, size=(2, 2))
        yaws = rng.uniform(-np.pi, np.pi, size=2)
        centres = transform_points(root, np.column_stack([spots, np.zeros(2)]))[:, :2]
        if not clear(centres, [radius, radius], GAP) or not all(inside(site, xy, radius) for xy in centres):
            return None
        if not all(in_reach(site, xy, (self._height - 0.02, self._height + 0.2)) for xy in centres):
            return None
        return [planar(xy, site.table_height, float(yaw)) for xy, yaw in zip(centres, yaws, strict=True)]


RIM_DEPTH, LIFT = 0.02, 0.15


def by_the_rim(obj: str, diameter: float, height: float, wall: float) -> Solution:
    """Lift an open cylinder, its origin in the middle of its underside, by the wall."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(obj)
        best = (-1.0, pose[:3, 3], pose[:3, 0])
        for outward in around(UP, pose[:3, 0], 16):
            point = pose[:3, 3] + outward * (diameter - wall) / 2 + UP * (height - RIM_DEPTH)
            for closing in (outward, -outward):
                margins = [
                    -1.0 if found is None else found.limit_margin
                    for z in (0.0, LIFT)
                    for found in [arm.inverse(rigid(grasp_rotation(DOWN, closing), point + z * UP))]
                ]
                best = max(best, (min(margins), point, closing), key=lambda choice: choice[0])
        _, point, closing = best
        yield pick(obj, np.asarray(point), np.asarray(closing), LIFT)

    return solve
