"""The planner: one picture, one path drawn into it, lifted into the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gvla2.errors import PlanningError
from gvla2.language import LanguageModel
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.pictures import read_path
from gvla2.skills.model_planning import ask_for_path, context, instruction_in, nothing_to_ask
from gvla2.skills.path_lifting import PathPoint
from gvla2_plugins.hamster.drawn import drawn

if TYPE_CHECKING:
    from gvla2_plugins.hamster import HamsterConfig

PROMPT = """In the image, please execute the command described in <quest>{quest}</quest>.
Provide a sequence of points denoting the trajectory of a robot gripper to achieve the goal.
Format your answer as a list of tuples enclosed by <ans> and </ans> tags. For example:
<ans>[({a:g}, {b:g}), <action>Close Gripper</action>, ({c:g}, {d:g}), <action>Open Gripper</action>, ...]</ans>
The tuple denotes point x and y location of the end effector of the gripper in the image. The action tags indicate the
gripper action.
The coordinates should be floats ranging between 0 and {scale:g}, indicating the relative locations of the points in
the image."""
"""HAMSTER's published prompt."""


class HamsterPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner` by a path in one picture."""

    def __init__(self, config: HamsterConfig, language: LanguageModel) -> None:
        self.config, self._language = config, language

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention; raises :class:`~gvla2.language.LanguageModelError` if no model answers."""
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        config, scale = self.config, self.config.scale
        try:
            view = config.view(request)
        except PlanningError as error:
            return Plan(None, abstention=Abstention("other", str(error)))

        def read(text: str) -> Sequence[Sequence[PathPoint]]:
            strokes = read_path(text, scale)
            as_drawn = drawn(strokes, view, request, config.travel)
            # The height of a drawn path is a guess; low is easier for arms to reach.
            level = drawn(strokes, view, request, config.travel, level=True)
            return [as_drawn, level]

        numbers = {name: share * scale for name, share in zip("abcd", (0.25, 0.32, 0.41, 0.74), strict=True)}
        words = PROMPT.format(quest=instruction_in(request), scale=scale, **numbers)
        messages = config.question(view, [words, *context(request)])
        return ask_for_path(self._language, messages, read, request, tries=config.tries)
