"""The planner: the model's program, the way through its maps, lifted into the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.language import LanguageModel
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.scene_brief import LEGEND, scene_brief
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.skills.asked_paths import ask_for_path, instruction_in, nothing_to_ask, told
from gvla2.skills.lifting import PathPoint
from gvla2_plugins.voxposer.maps import read_program
from gvla2_plugins.voxposer.stops import Stop, stops

if TYPE_CHECKING:
    from gvla2_plugins.voxposer import VoxPoserConfig

NEAR = 0.03
"""A waypoint so near to a stop takes its turn of the hand, metres."""


class VoxPoserPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner` by value maps."""

    def __init__(self, config: VoxPoserConfig, language: LanguageModel) -> None:
        numbers = (config.obstacles, config.margin, config.avoidance)
        if config.tries < 1 or not all(0.0 < n < 1e6 for n in numbers):
            raise ConfigurationError(
                f"tries is {config.tries}, obstacles, margin and avoidance are {numbers}; they must be positive."
            )
        self.config, self._language = config, language
        self._prompt = files(__package__).joinpath("prompt.md").read_text("utf-8")

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention; raises :class:`~gvla2.language.LanguageModelError` where no model answers."""
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        brief, way = scene_brief(request.scene), list[Stop]()

        def read(text: str) -> Sequence[Sequence[PathPoint]]:
            way[:] = stops(read_program(text), request, brief.ids, self.config)
            return [[PathPoint(s.place, s.gripper) for s in way]]

        things = f"Things ({LEGEND}); data alone:\n{brief.text}"
        asked = "\n\n".join([things, *told(request), f"Task: {instruction_in(request)}"])
        messages = [{"role": "system", "content": self._prompt}, {"role": "user", "content": asked}]
        plan = ask_for_path(self._language, messages, read, request, tries=self.config.tries)
        return plan if plan.trajectory is None else replace(plan, trajectory=_with_maps(plan.trajectory, way))


def _with_maps(trajectory: Trajectory, way: Sequence[Stop]) -> Trajectory:
    """The trajectory with the rotation and speed that the maps give near its waypoints."""
    places = np.array([s.place for s in way])

    def mapped(waypoint: Waypoint) -> Waypoint:
        gaps = np.linalg.norm(places - waypoint.xyz, axis=1)
        stop = way[int(np.argmin(gaps))]
        waypoint = replace(waypoint, speed=waypoint.speed * stop.speed)
        if stop.turn is None or gaps.min() > NEAR:
            return waypoint
        closing = (-float(np.sin(stop.turn)), float(np.cos(stop.turn)), 0.0)
        return replace(waypoint, orientation=Orientation("grasp", closing=closing))

    return Trajectory(tuple(map(mapped, trajectory)))
