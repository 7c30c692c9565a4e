"""Push a block onto a square that is painted on the table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.placing import in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.solids import Volume
from gvla2.robot.task import Body, Layout, Primitive, Solution, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import PushBlockConfig
from gvla2_plugins.tabletop.moves import DOWN, UP, best_closing, stop
from gvla2_plugins.tabletop.scenes import PAINT, sample_colours

CENTRE_VOLUME = 0.01
"""Side of the strict profile's cube at the target's centre, metres."""

ROOM_BEHIND = 0.08
"""How far behind the block, seen from the target, the hand must reach to push it, metres."""


class PushBlock:
    """Push the block onto the target.

    relaxed: the block's centre is above the painted square and the block lies on the table. strict: the block
    overlaps a cube of 1 cm that stands at the target's centre.
    """

    instructions = (
        "push the {colour} block onto the {target} square",
        "slide the {colour} cube to the {target} target",
        "shove the {colour} block over to the {target} patch on the table",
        "move the {colour} cube onto the {target} square by pushing it",
        "without lifting it, push the {colour} block until it is on the {target} target",
    )
    """Paraphrases; ``{colour}`` is the block's colour, ``{target}`` the square's."""

    def __init__(self, config: PushBlockConfig) -> None:
        near, far = config.distance
        if min(config.size, config.mass, config.target, near) <= 0 or near > far:
            raise ConfigurationError(
                "task=push_block needs positive size, mass, target and an increasing distance range, got "
                f"size={config.size}, mass={config.mass}, target={config.target}, distance=({near}, {far})."
            )
        self._config = replace(config, size=config.size * config.factor("push_block"))

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; there is one block and one target, whatever ``instruction`` says."""
        size, side, table = self._config.size, self._config.target, site.table_height
        block, target = sample_until(lambda: self._draw_poses(rng, site), "a block and its target")
        block_colour, target_colour = sample_colours(rng, site, 2)
        template = self.instructions[int(rng.integers(len(self.instructions)))]
        sentence = template.format(colour=block_colour, target=target_colour)
        cube = Primitive("box", (size, size, size), COLOURS[block_colour])
        paint = Primitive("box", (side, side, PAINT), COLOURS[target_colour], collides=False)
        bodies = (
            Body("block", (cube,), block, self._config.mass, label=f"{block_colour} cube"),
            Body("target", (paint,), target, fixed=True, label=f"{target_colour} square"),
        )
        middle = rigid(target[:3, :3], (target[0, 3], target[1, 3], table + CENTRE_VOLUME / 2))
        volume = Volume(middle, (CENTRE_VOLUME, CENTRE_VOLUME, CENTRE_VOLUME))

        def relaxed(world: WorldState) -> bool:
            now = world.pose("block")[:3, 3]
            offset = transform_points(invert_rigid(target), now)
            return bool((np.abs(offset[:2]) <= side / 2).all() and now[2] < table + size)

        def strict(world: WorldState) -> bool:
            return volume.meets(bodies[0], world.pose("block"))

        return TaskInstance(
            Layout(bodies),
            sentence if instruction is None else instruction,
            {"relaxed": relaxed, "strict": strict},
            f"relaxed: the {block_colour} block's centre is on the {target_colour} square; "
            "strict: the block covers the square's centre",
            solution=push_to("block", "target", size),
        )

    def _draw_poses(self, rng: np.random.Generator, site: TaskSite) -> tuple[FloatArray, FloatArray] | None:
        """Poses (4, 4) of the block's and the paint's centre; None when one is out of place."""
        size = self._config.size
        root = sample_root(rng, site)
        distance = float(rng.uniform(*self._config.distance))
        direction, block_yaw, target_yaw = rng.uniform(-np.pi, np.pi, size=3)
        start = root[:2, 3]
        towards = np.array([np.cos(direction), np.sin(direction)])
        goal = start + distance * towards
        free = distance - (size + self._config.target) / np.sqrt(2.0) > 0
        if not free or not inside(site, start, size / np.sqrt(2.0)):
            return None
        if not inside(site, goal, self._config.target / np.sqrt(2.0)):
            return None
        if not all(in_reach(site, xy, (size / 2, 0.15)) for xy in (start - ROOM_BEHIND * towards, goal)):
            return None
        return (
            planar(start, site.table_height + size / 2, float(block_yaw)),
            planar(goal, site.table_height + PAINT / 2, float(target_yaw)),
        )


def push_to(obj: str, goal: str, size: float) -> Solution:
    """Push the cube ``obj`` of that ``size`` over the table until its middle is on the origin of ``goal``.

    Two pushes: the second corrects the first one's drift from friction.
    """

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        for share in (0.6, 1.0):
            block, target = world.pose(obj), world.pose(goal)[:3, 3]
            way = (target - block[:3, 3]) * (1.0, 1.0, 0.0)
            ahead = way / np.linalg.norm(way)
            behind = _half_width(block, ahead, size) + 0.5 * arm.hand.finger_breadth
            height = UP * (block[2, 3] - 0.2 * size)
            flat = np.array([1.0, 1.0, 0.0])
            start = block[:3, 3] * flat - ahead * (behind + 0.025) + height
            end = (block[:3, 3] + share * way) * flat - ahead * behind + height
            across = np.cross(UP, ahead)
            closing = best_closing(arm, [start + 0.08 * UP, start, end], [across, -across])
            near = {obj, "table"}
            yield [
                stop("approach", start + 0.08 * UP, 0.0, DOWN, closing, free=True),
                stop("lower", start, 0.0, contacts=near),
                stop("push", end, 0.0, speed=0.1, contacts=near),
                stop("back", end - 0.04 * ahead, 0.0, contacts=near),
                stop("leave", end - 0.04 * ahead + 0.1 * UP, 0.0, contacts=near),
            ]

    return solve


def _half_width(block: FloatArray, ahead: FloatArray, size: float) -> float:
    """From the middle of a square to its edge, against the direction ``ahead`` (3,), metres."""
    return 0.5 * size / float(np.max(np.abs(block[:3, :2].T @ ahead)))
