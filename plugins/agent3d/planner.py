"""The planner: brief the model, read its waypoints, lift them, and tell it what the checks found, twice at most."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gvla2.errors import PlanningError
from gvla2.language import LanguageModel, UnusableAnswerError, ask_typed
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.programs import waypoints_program
from gvla2.planning.scene_brief import SceneBrief, scene_brief
from gvla2.skills.lifting import lift
from gvla2.skills.waypoints import Step, grammar, path_of, read_steps, schema, with_ids
from gvla2_plugins.agent3d import Agent3dConfig
from gvla2_plugins.agent3d.prompt import messages, rejected_path

BACK = 2
"""So often the reasons why a path cannot be carried out go back to the model."""


class Agent3d:
    """Implements :class:`gvla2.planning.contracts.Planner` by a language model's waypoints (paper: 3DAgent)."""

    def __init__(self, config: Agent3dConfig, language: LanguageModel) -> None:
        self.config = config
        self._language = language
        self._bare = config.waypoints == "bare"
        self._options = SkillOptions(speed=config.speed, contact_speed=config.contact_speed)

    def plan(self, request: PlanRequest) -> Plan:
        """A plan along the model's waypoints, or an abstention with all that was said.

        Raises :class:`gvla2.language.LanguageModelError` when the model cannot be asked.
        """
        if not request.instruction.strip():
            return Plan(None, abstention=Abstention("unknown_skill", "The instruction is empty."))
        if not request.scene.objects:
            return Plan(None, abstention=Abstention("nothing_matches", "Nothing was seen on the table."))
        bare = self._bare
        brief = scene_brief(request.scene, positions=bare, points=self.config.points)
        asked = messages(request, brief, bare=bare, programs=self.config.programs)
        if request.rejections:
            asked += rejected_path(
                [brief.named(why, request.scene) for why in request.rejections], _written(request.rejected)
            )
        said: tuple[Mapping[str, Any], ...] = ()
        plan = Plan(None, abstention=Abstention("other", "There is no path."))
        for turn in range(1 + BACK):
            try:
                steps, transcript = self._ask(asked, brief, turn)
            except UnusableAnswerError as error:
                if not any(entry["answer"] for entry in error.transcript):
                    raise  # nobody is there
                refused = Abstention("other", f"The model wrote no path: {error}")
                return replace(plan, abstention=refused, transcript=(*said, *error.transcript))
            said += transcript
            plan = self._lifted(steps, brief, request)
            if plan.abstention is None:
                break
            asked += rejected_path([brief.named(plan.abstention.message, request.scene)], _path(steps))
        return replace(plan, transcript=said)

    def _ask(
        self, asked: list[Any], brief: SceneBrief, turn: int
    ) -> tuple[list[Step], tuple[Mapping[str, Any], ...]]:
        config, names = self.config, list(brief.ids)
        warm = max(config.explore, 0.5 if turn else 0.0)
        answered = ask_typed(
            self._language,
            asked,
            lambda text: read_steps(text, brief.ids, bare=self._bare),
            purpose="plan",
            schema=schema(names, bare=self._bare),
            grammar=grammar(names, bare=self._bare),
            tries=config.tries,
            samples=config.samples,
            seed=config.explore_seed + 100 * turn,
            temperature=warm or None,
            max_tokens=config.max_tokens,
        )
        return answered.answer, answered.transcript

    def _lifted(self, steps: list[Step], brief: SceneBrief, request: PlanRequest) -> Plan:
        try:
            path = path_of(steps, brief.ids, request.scene, bare=self._bare)
            plan = lift(path, request, self._options)
        except (PlanningError, ValueError) as error:
            return Plan(None, abstention=Abstention("other", str(error)))
        if self._bare:
            return plan
        program = waypoints_program(
            with_ids(steps, brief.ids), request.scene, roles=plan.roles, skill=plan.skill,
            instruction=request.instruction,
        )  # fmt: skip
        return replace(plan, program=program)


def _path(steps: list[Step]) -> str:
    return json.dumps(steps, separators=(",", ":"))


def _written(plan: Plan | None) -> str:
    """What the model wrote of the rejected plan, from its transcript; "" where that is not known."""
    answers = [str(entry.get("answer", "")) for entry in plan.transcript] if plan is not None else []
    return answers[-1] if answers else ""
