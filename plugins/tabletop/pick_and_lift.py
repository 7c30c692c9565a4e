"""Pick and lift: three cubes, one of them named by its colour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.colours import COLOURS, colours_in
from gvla2.robot.placing import in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.solids import body_points
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import PickAndLiftConfig
from gvla2_plugins.tabletop.moves import hold_up
from gvla2_plugins.tabletop.scenes import sample_colours

START_VOLUME = (0.30, 0.30, 0.03)
"""The volume of the relaxed profile, standing on the table about the cube's starting place, metres."""

SENSOR_HEIGHT, SENSOR_THICKNESS = 0.248, 0.05
"""The sensor of the strict profile, metres above the table. Only its height is published; we assume a slab of 5 cm
around that height, triggered by any part of the cube, like a proximity sensor."""


class PickAndLift:
    """Lift the cube of the named colour.

    relaxed: the cube has left a volume of 0.3 x 0.3 x 0.03 m that stands on the table about its starting place: no
    part of it is below the volume's top, or its centre is beyond the volume's sides. strict: both fingers hold the
    cube and some part of it is in the sensor's slab.
    """

    instructions = (
        "pick up the {colour} cube and lift it up",
        "lift the {colour} block off the table",
        "grab the {colour} cube and raise it into the air",
        "take the {colour} block and hold it up high",
        "could you pick up the {colour} cube, please?",
        "grasp the cube that is {colour} and lift it up to the target height",
    )
    """Paraphrases; ``{colour}`` is the cube's colour."""

    def __init__(self, config: PickAndLiftConfig) -> None:
        if config.cubes < 1 or config.size <= 0 or config.mass <= 0:
            raise ConfigurationError(
                f"task=pick_and_lift needs at least one cube of positive size and mass, got cubes={config.cubes}, "
                f"size={config.size}, mass={config.mass}."
            )
        self._config = replace(config, size=config.size * config.factor("pick_and_lift"))

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; a given ``instruction`` decides the cube if it names the colour of exactly one."""
        size = self._config.size
        poses = sample_until(lambda: self._draw_poses(rng, site), f"{self._config.cubes} cubes")
        colours = sample_colours(rng, site, self._config.cubes)
        target = int(rng.integers(len(poses)))
        sentence = self.instructions[int(rng.integers(len(self.instructions)))].format(colour=colours[target])
        aside = ""
        if instruction is not None:
            sentence = instruction
            named = [i for i, colour in enumerate(colours) if colour in colours_in(instruction)]
            if len(named) == 1:
                target = named[0]
            else:
                aside = (
                    "; the sentence names no single cube by its colour, so the seed's own target is judged"
                )
        bodies = tuple(
            Body(
                f"cube_{i}",
                (Primitive("box", (size, size, size), COLOURS[colour]),),
                pose,
                self._config.mass,
                label=f"{colour} cube",
            )
            for i, (pose, colour) in enumerate(zip(poses, colours, strict=True))
        )
        body, start = f"cube_{target}", poses[target]
        extents = np.full(3, size)

        def relaxed(world: WorldState) -> bool:
            offset = transform_points(invert_rigid(start), world.pose(body)[:3, 3])
            low = body_points(bodies[target], world.pose(body))[:, 2].min()
            within = np.abs(offset[:2]) <= 0.5 * np.asarray(START_VOLUME[:2])
            return not (within.all() and low <= site.table_height + START_VOLUME[2])

        def strict(world: WorldState) -> bool:
            heights = body_points(bodies[target], world.pose(body))[:, 2]
            sensor = site.table_height + SENSOR_HEIGHT
            return (
                world.held(body)
                and heights.min() <= sensor + SENSOR_THICKNESS / 2
                and heights.max() >= sensor - SENSOR_THICKNESS / 2
            )

        return TaskInstance(
            Layout(bodies),
            sentence,
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the {colours[target]} cube has left its place on the table; "
            f"strict: the fingers hold it about {SENSOR_HEIGHT} m above the table{aside}",
            solution=hold_up(body, extents, SENSOR_HEIGHT - size / 2),
        )

    def _draw_poses(self, rng: np.random.Generator, site: TaskSite) -> list[FloatArray] | None:
        """Poses (4, 4) of all cubes in the area about a random root; None when one is out of place."""
        size = self._config.size
        radius = size / np.sqrt(2.0)
        root = sample_root(rng, site)
        half = 0.5 * np.asarray(self._config.area) - radius
        if (half < 0).any():
            return None
        spots = rng.uniform(-half, half, size=(self._config.cubes, 2))
        yaws = rng.uniform(-np.pi, np.pi, size=self._config.cubes)
        centres = transform_points(root, np.column_stack([spots, np.zeros(len(spots))]))[:, :2]
        for i, centre in enumerate(centres):
            apart = np.linalg.norm(centres[:i] - centre, axis=1) - 2 * radius
            if not inside(site, centre, radius) or (apart < self._config.gap).any():
                return None
        # Reach last: inverse kinematics costs more than everything else.
        if not all(in_reach(site, centre, (size / 2, SENSOR_HEIGHT + size)) for centre in centres):
            return None
        return [
            planar(centre, site.table_height + size / 2, float(yaw))
            for centre, yaw in zip(centres, yaws, strict=True)
        ]
