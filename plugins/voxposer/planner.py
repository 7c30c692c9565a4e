"""The planner: the model's program, the way through its maps, lifted into the scene and checked."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.language import LanguageModel
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.scene import Box, Scene
from gvla2.planning.scene_brief import LEGEND, scene_brief
from gvla2.skills.model_planning import ask_for_path, context, instruction_in, nothing_to_ask
from gvla2.skills.path_lifting import PathPoint
from gvla2_plugins.voxposer.maps import MapInterpreter, Move, read_program
from gvla2_plugins.voxposer.voxel_route import VoxelGrid

if TYPE_CHECKING:
    from gvla2_plugins.voxposer import VoxPoserConfig


def stops(
    moves: Sequence[Move], request: PlanRequest, ids: Mapping[str, str], c: VoxPoserConfig
) -> list[PathPoint]:
    """The hand's path, open at first; raises :class:`ValueError` for maps without a meaning."""
    scene, arm = request.scene, request.arm
    low = np.maximum(scene.workspace.low, arm.workspace.low).clip(min=[-np.inf, -np.inf, scene.table_height])
    box = Box(low, np.minimum(scene.workspace.high, arm.workspace.high))
    grid = VoxelGrid.over(box, c.voxel)
    everywhere = MapInterpreter(scene, ids, grid.centres())
    found: list[PathPoint] = []
    at, gripper, held = np.clip(request.start[:3, 3], box.low, box.high), 1.0, ""
    for move in moves:
        maps = {name: everywhere.values(map_) for name, map_ in move.items()}
        avoided = np.clip(maps.get("avoidance", np.zeros(grid.shape)), 0.0, 1.0)
        peak = grid.peak(partial(_values, move["affordance"], scene, ids), avoided)
        goal = np.clip(peak, box.low, box.high)
        # Not obstacles: the start and end of the move, held objects, and the target of a closed, empty hand.
        line = np.linspace(at, goal, 50 if gripper < 0.5 and not held else 2)
        ends = {held, *map(scene.object_at, line)}
        clear = grid.clearance([o for o in scene.obstacles() if o.id not in ends], grown=c.margin)
        costs = 1.0 + c.obstacles * np.exp(-clear / c.margin) + c.avoidance * avoided
        # A number for the hand applies at the end of the move, a map with several values at their places.
        varied = np.ptp(maps.get("gripper", np.zeros(1))) > 0.0
        way = grid.route(costs, at, goal)
        for number, point in enumerate(way[1:], 2):
            hand = gripper
            if "gripper" in maps and (varied or number == len(way)):
                hand = float(np.clip(maps["gripper"][tuple(grid.indices(point))], 0.0, 1.0))
            x, y, z = map(float, point)
            found.append(PathPoint((x, y, z), hand))
        if found[-1].gripper >= 0.5 or gripper >= 0.5:
            held = "" if found[-1].gripper >= 0.5 else scene.object_at(goal)
        at, gripper = goal, found[-1].gripper
    return found


def _values(map_: ast.expr, scene: Scene, ids: Mapping[str, str], points: FloatArray) -> FloatArray:
    return MapInterpreter(scene, ids, points).values(map_)


class VoxPoserPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner` by value maps."""

    def __init__(self, config: VoxPoserConfig, language: LanguageModel) -> None:
        self.config, self._language = config, language
        self._prompt = files(__package__).joinpath("prompt.md").read_text("utf-8")

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention; raises :class:`~gvla2.language.LanguageModelError` if no model answers."""
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        brief = scene_brief(request.scene)

        def read(text: str) -> Sequence[Sequence[PathPoint]]:
            return [stops(read_program(text), request, brief.ids, self.config)]

        objects, task = f"Objects ({LEGEND}), data only:\n{brief.text}", f"Task: {instruction_in(request)}"
        asked = "\n\n".join([objects, *context(request), task])
        messages = [{"role": "system", "content": self._prompt}, {"role": "user", "content": asked}]
        return ask_for_path(self._language, messages, read, request, tries=self.config.tries)
