"""From value maps to the stops of the hand: the peak of each move's affordance, and the cheapest way there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import PlanRequest
from gvla2.planning.pixels import object_at
from gvla2.planning.scene import Box
from gvla2.planning.voxel_route import VoxelGrid
from gvla2_plugins.voxposer.maps import Field, Program

if TYPE_CHECKING:
    from gvla2_plugins.voxposer import VoxPoserConfig

SLOWEST, FASTEST = 0.1, 2.0
"""Bounds of the speed map, shares of the usual speed."""
AT_HAND = 0.02
"""A hand that closes no farther from a thing takes hold of it, metres."""
FINER = 4
"""A peak is looked for again on a grid so much finer, twice."""


@dataclass(frozen=True)
class Stop:
    """``place`` in world metres, ``gripper`` in [0, 1] after arriving, ``turn`` about the vertical, radians, or None.

    ``speed`` is a share of the usual one.
    """

    place: tuple[float, float, float]
    gripper: float
    turn: float | None
    speed: float


def stops(
    program: Program, request: PlanRequest, ids: Mapping[str, str], config: VoxPoserConfig
) -> list[Stop]:
    """The way of the hand, open at first; raises :class:`ValueError` for maps that mean nothing."""
    scene, arm = request.scene, request.arm
    low = np.maximum(scene.workspace.low, arm.workspace.low)
    low[2] = max(low[2], scene.table_height)
    box = Box(low, np.minimum(scene.workspace.high, arm.workspace.high))
    grid = VoxelGrid.over(box, config.voxel)
    centres = grid.centres()
    everywhere = Field(scene, ids, program, centres)
    found: list[Stop] = []
    at, gripper, held = np.clip(request.start[:3, 3], box.low, box.high), 1.0, ""
    for stage in program.stages:
        maps = {name: everywhere.values(map_) for name, map_ in stage.items()}
        avoided = np.clip(maps.get("avoidance", np.zeros(grid.shape)), 0.0, 1.0)
        goal = _best(maps["affordance"], centres, avoided)
        for step in (grid.size, grid.size / FINER):
            offsets = step * np.arange(-FINER, FINER + 1) / FINER
            around = goal + np.stack(np.meshgrid(offsets, offsets, offsets), axis=-1)
            goal = _best(Field(scene, ids, program, around).values(stage["affordance"]), around)
        goal = np.clip(goal, box.low, box.high)
        # Not in the way: what the move begins or ends at, what is held, and what a closed, empty hand goes straight to.
        line = np.linspace(at, goal, 50 if gripper < 0.5 and not held else 2)
        ends = {held, *(object_at(point, scene) for point in line)}
        clear = grid.clearance([o for o in scene.obstacles() if o.id not in ends], grown=config.margin)
        costs = 1.0 + config.obstacles * np.exp(-clear / config.margin) + config.avoidance * avoided
        # A number for the hand is meant for the end of the move, a map with several of them for where it says so.
        varied = np.ptp(maps.get("gripper", np.zeros(1))) > 0.0
        way = grid.route(costs, at, goal)
        for number, point in enumerate(way[1:], 2):
            given = {name: float(map_[tuple(grid.indices(point))]) for name, map_ in maps.items()}
            hand = given.get("gripper", gripper) if varied or number == len(way) else gripper
            turn = float(np.radians(given["rotation"])) if "rotation" in given else None
            speed = float(np.clip(given.get("speed", 1.0), SLOWEST, FASTEST))
            x, y, z = (float(v) for v in point)
            found.append(Stop((x, y, z), float(np.clip(hand, 0.0, 1.0)), turn, speed))
        if found[-1].gripper >= 0.5:
            held = ""
        elif gripper >= 0.5:
            held = object_at(goal, scene)
        at, gripper = goal, found[-1].gripper
    closes = next((k for k, stop in enumerate(found) if stop.gripper < 0.5), 0)
    if found[closes].gripper < 0.5 and not object_at(np.array(found[closes].place), scene, within=AT_HAND):
        # Closed in the open it is to push or press: the way there is as good as any.
        return list(takewhile(lambda stop: stop.gripper < 0.5, found[closes:]))
    return found


def _best(values: FloatArray, points: FloatArray, avoided: FloatArray | None = None) -> FloatArray:
    """(3,) the point of the highest value: of several the least avoided, and of these the one in their middle."""
    spread = float(np.ptp(values))
    if avoided is not None and spread == 0.0:
        raise ValueError("An affordance is the same everywhere; say where to go.")
    top = values >= values.max() - 1e-9 * max(1.0, spread)
    best = points[top]
    if avoided is not None:
        best = best[avoided[top] <= avoided[top].min() + 1e-9]
    return np.asarray(best[np.argmin(np.linalg.norm(best - best.mean(axis=0), axis=1))])
