"""From value maps to the stops of the hand: the peak of each move's affordance, and the cheapest way there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import PlanRequest
from gvla2.planning.pixels import object_at
from gvla2.planning.scene import Box
from gvla2.planning.voxel_route import VoxelGrid
from gvla2_plugins.voxposer.maps import Field, Program, Stage

if TYPE_CHECKING:
    from gvla2_plugins.voxposer import VoxPoserConfig

SLOWEST, FASTEST = 0.1, 2.0
"""Bounds of the speed map, shares of the usual speed."""
FINER = 4
"""A peak is looked for again on a grid so much finer, twice."""


@dataclass(frozen=True)
class Stop:
    """``xyz`` (3,) metres, ``gripper`` in [0, 1] after arriving, ``turn`` in radians about the vertical, None for any."""

    stage: str
    xyz: FloatArray
    gripper: float
    turn: float | None
    speed: float


def stops(program: Program, request: PlanRequest, ids: Mapping[str, str], config: VoxPoserConfig) -> list[Stop]:
    """The way of the hand; raises :class:`ValueError` for maps that mean nothing."""
    scene, arm = request.scene, request.arm
    low = np.maximum(scene.workspace.low, arm.workspace.low)
    low[2] = max(low[2], scene.table_height)
    box = Box(low, np.minimum(scene.workspace.high, arm.workspace.high))
    grid, field = VoxelGrid.over(box, config.voxel), Field(scene, ids, program)
    centres, found = grid.centres(), list[Stop]()
    at, gripper, held = np.clip(request.start[:3, 3], box.low, box.high), 1.0, ""
    for stage in program.stages:
        maps = {name: field.at(map_, centres) for name, map_ in stage.maps.items()}
        avoided = np.clip(maps.get("avoidance", np.zeros(grid.shape)), 0.0, 1.0)
        goal = np.clip(_peak(field, stage, grid, maps["affordance"], avoided), box.low, box.high)
        ends = {held, object_at(at, scene), object_at(goal, scene)}
        clear = grid.clearance([o for o in scene.obstacles() if o.id not in ends], grown=config.margin)
        costs = 1.0 + config.obstacles * np.exp(-clear / config.margin) + config.avoidance * avoided
        for point in grid.route(costs, at, goal)[1:]:
            here = tuple(grid.indices(point))
            given = {name: float(values[here]) for name, values in maps.items()}
            wanted = float(np.clip(given.get("gripper", gripper), 0.0, 1.0))
            # A number for the hand is meant for the end of the move, a map of several for where it says so.
            if point is not goal and np.ptp(maps.get("gripper", np.zeros(1))) == 0.0:
                wanted = gripper if not np.array_equal(point, goal) else wanted
            turn = np.radians(given["rotation"]) if "rotation" in given else None
            speed = float(np.clip(given.get("speed", 1.0), SLOWEST, FASTEST))
            found.append(Stop(stage.name, point, wanted, turn, speed))
        at, before, gripper = goal, gripper, found[-1].gripper
        held = object_at(goal, scene) if gripper < before else held if gripper <= before else ""
    return found


def _peak(field: Field, stage: Stage, grid: VoxelGrid, values: FloatArray, avoided: FloatArray) -> FloatArray:
    """(3,) where the affordance is highest: of several such places the least avoided, and of these the middle one."""
    best = np.argwhere(values >= values.max() - 1e-9 * max(1.0, float(np.ptp(values))))
    if len(best) == values.size:
        raise ValueError(f"The affordance of '{stage.name}' is the same everywhere; say where to go.")
    passed = avoided[tuple(best.T)]
    best = best[passed <= passed.min() + 1e-9]
    point = _middle(grid.low + grid.size * (best + 0.5))
    size = grid.size
    for _ in range(2):
        steps = size * np.arange(-FINER, FINER + 1) / FINER
        size /= FINER
        around = point + np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        near = field.at(stage.maps["affordance"], around)
        point = _middle(around[near >= near.max() - 1e-9 * max(1.0, float(np.ptp(near)))])
    return point


def _middle(points: FloatArray) -> FloatArray:
    """(3,) of points (N, 3) the one nearest to their mean."""
    return np.asarray(points[np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1))])
