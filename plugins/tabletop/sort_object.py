"""Sort three objects into two bins by colour."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.colours import COLOURS
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.placing import at, clear, in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.solids import on, tray
from gvla2.robot.task import Body, Layout, Primitive, Solution, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig
from gvla2_plugins.tabletop.moves import put_on
from gvla2_plugins.tabletop.scenes import lifted, sample_colours, sentence_of

BIN, WALL = (0.17, 0.17, 0.05), 0.006
CUBE, CAN, BAR = (0.045, 0.045, 0.045), (0.045, 0.045, 0.07), (0.035, 0.07, 0.04)
MASS = 0.1
GAP = 0.05
OVER = 0.10
ASIDE = 0.035
"""Metres, kilograms: an object is in a bin when its middle is within its walls, no higher than ``OVER``. Two objects of
one colour fit ``ASIDE`` of the bin's middle, on either side."""

TOGETHER, ONE_BY_ONE, AFRESH = 1000, 200, 50
"""Number of draws of all five places together, of single places before starting over, and of restarts."""


class SortObject:
    """Put each object into the bin of its own colour. relaxed: all three are in. strict: and let go of, at rest."""

    instructions = (
        "sort the objects into the bins of the same colour",
        "put every object into the bin that has its colour",
        "put the {one} things in the {one} bin and the {other} things in the {other} bin",
        "sort the {one} and {other} objects into the bins of their own colour",
        "place each object in the box of matching colour",
    )
    """Paraphrases; ``{one}`` and ``{other}`` are the bins' colours."""

    def __init__(self, config: ScaledConfig) -> None:
        k = config.factor("sort_object")
        self._sizes = [np.array(size) * k for size in (CUBE, CAN, BAR)]

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; all objects are to be sorted, whatever ``instruction`` says."""
        poses = self._places(rng, site)
        colours = sample_colours(rng, site, 2)
        belongs = [0, 1, int(rng.integers(2))]
        bins = tuple(
            Body(f"bin_{i}", tray(BIN, WALL, COLOURS[c]), poses[i], fixed=True, label=f"{c} bin", shape="box")
            for i, c in enumerate(colours)
        )
        objects = []
        for i, (name, size) in enumerate(zip(("cube", "can", "bar"), self._sizes, strict=True)):
            colour = colours[belongs[i]]
            x, y, z = (float(side) for side in size)
            solid = Primitive("cylinder" if name == "can" else "box", (x, y, z), COLOURS[colour])
            pose = poses[2 + i] @ lifted(z / 2)
            objects.append(Body(name, (solid,), pose, MASS, label=f"{colour} {name}"))
        inner = BIN[0] - 2 * WALL
        volumes = [on(poses[i], (inner, inner), OVER) for i in range(2)]

        def relaxed(world: WorldState) -> bool:
            return all(
                volumes[k].holds(world.pose(obj.name)[:3, 3]) and not world.held(obj.name)
                for obj, k in zip(objects, belongs, strict=True)
            )

        def strict(world: WorldState) -> bool:
            return relaxed(world) and all(world.resting(obj.name) for obj in objects)

        return TaskInstance(
            Layout((*bins, *objects)),
            sentence_of(rng, self.instructions, instruction, one=colours[0], other=colours[1]),
            {"relaxed": relaxed, "strict": strict},
            "relaxed: each object is in the bin of its colour; strict: at rest there, let go of",
            solution=self._solution(belongs),
        )

    def _solution(self, belongs: list[int]) -> Solution:
        def solve(world: WorldState, arm: Arm) -> Iterator[Sequence[Waypoint]]:
            for i, name in enumerate(("cube", "can", "bar")):
                shares = belongs.count(belongs[i]) > 1
                aside = ASIDE * (1 if belongs.index(belongs[i]) == i else -1) * shares
                goal = f"bin_{belongs[i]}"
                offset = np.array([aside, 0.0, 0.0])
                others = ("bin_0", "bin_1", "cube", "can", "bar")
                put = put_on(name, goal, self._sizes[i], rise=WALL, offset=offset, contacts=others)
                yield from put(world, arm)

        return solve

    def _places(self, rng: np.random.Generator, site: TaskSite) -> list[FloatArray]:
        """Poses (4, 4) of the undersides of both bins and the three objects: drawn at once, where there is room."""
        for _ in range(TOGETHER):
            roots = [sample_root(rng, site) for _ in range(5)]
            if self._apart(site, roots) and all(self._in_reach(site, i, roots[i]) for i in (2, 3, 4, 0, 1)):
                return [_turned(root, site) for root in roots]
        crowded = sample_until(lambda: self._one_by_one(rng, site), "two bins and three objects", AFRESH)
        return [_turned(root, site) for root in crowded]

    def _one_by_one(self, rng: np.random.Generator, site: TaskSite) -> list[FloatArray] | None:
        """Each object beside those that lie already: for a small reach, where five together hardly ever fit."""
        roots: list[FloatArray] = []
        for _ in range(ONE_BY_ONE):
            root = sample_root(rng, site)
            if self._apart(site, [*roots, root]) and self._in_reach(site, len(roots), root):
                roots.append(root)
            if len(roots) == 5:
                return roots
        return None

    def _apart(self, site: TaskSite, roots: list[FloatArray]) -> bool:
        """Whether the first of the bins and objects lie in the site, apart from one another."""
        spots = np.stack([root[:2, 3] for root in roots])
        radii = [BIN[0] / np.sqrt(2)] * 2 + [float(np.hypot(*size[:2])) / 2 for size in self._sizes]
        radii = radii[: len(roots)]
        within = all(inside(site, xy, min(r, BIN[0] / 2)) for xy, r in zip(spots, radii, strict=True))
        return within and clear(spots, radii, GAP)

    def _in_reach(self, site: TaskSite, index: int, root: FloatArray) -> bool:
        """Whether the hand gets to the object, or to both places in the bin."""
        sides = (-1.0, 1.0) if index < 2 else (0.0,)
        return all(in_reach(site, at(root, side * ASIDE, 0.0)[:2, 3], (0.02, 0.24)) for side in sides)


def _turned(root: FloatArray, site: TaskSite) -> FloatArray:
    return planar(root[:2, 3], site.table_height, float(np.arctan2(root[1, 0], root[0, 0])))
