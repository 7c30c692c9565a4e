"""The planner: brief the model, read its waypoints, lift them, and return the checks' findings to it, at most twice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gvla2.errors import PlanningError
from gvla2.language import LanguageModel, UnusableAnswerError, ask_typed
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.programs import waypoints_program
from gvla2.planning.scene_brief import SceneBrief, scene_brief
from gvla2.programs.remembered import Remembered, remembered_paths
from gvla2.programs.waypoints import Step, grammar, path_of, read_steps, schema, with_ids, written
from gvla2.skills.asked_paths import last_answer, nothing_to_ask
from gvla2.skills.lifting import lift
from gvla2.skills.mentions import roles_said
from gvla2_plugins.agent3d import Agent3dConfig
from gvla2_plugins.agent3d.prompt import messages, rejected_path

BACK = 2
"""How often the reasons for an infeasible path go back to the model."""


class Agent3d:
    """Implements :class:`gvla2.planning.contracts.Planner` by a language model's waypoints (paper: 3DAgent)."""

    def __init__(self, config: Agent3dConfig, language: LanguageModel) -> None:
        self.config = config
        self._language = language
        self._bare = config.waypoints == "bare"
        self._options = SkillOptions(speed=config.speed, contact_speed=config.contact_speed)

    def plan(self, request: PlanRequest) -> Plan:
        """A plan along the model's waypoints, or an abstention with the whole conversation.

        Raises :class:`gvla2.language.LanguageModelError` when the model cannot be asked.
        """
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        bare = self._bare
        brief = scene_brief(request.scene, positions=bare, points=self.config.points)
        known = [] if bare else remembered_paths(request, brief, self.config.programs, self._options)
        asked, held = messages(request, brief, known, bare=bare), self._held(request, brief, known)
        if request.rejections:
            why = [brief.named(reason, request.scene) for reason in request.rejections]
            asked += rejected_path(why, last_answer(request.rejected))
        said: tuple[Mapping[str, Any], ...] = ()
        plan = Plan(None, abstention=Abstention("other", "There is no path."))
        for turn in range(1 + BACK):
            try:
                steps, transcript = self._ask(asked, brief, held, turn)
            except UnusableAnswerError as error:
                if not any(entry["answer"] for entry in error.transcript):
                    raise  # no server
                refused = Abstention("other", f"The model wrote no path: {error}")
                return replace(plan, abstention=refused, transcript=(*said, *error.transcript))
            said += transcript
            plan = self._lifted(steps, brief, request)
            if plan.abstention is None:
                break
            asked += rejected_path([brief.named(plan.abstention.message, request.scene)], written(steps))
        return replace(plan, transcript=said)

    def _held(self, request: PlanRequest, brief: SceneBrief, known: Sequence[Remembered]) -> str:
        """The grammar of the answer. A path begins at the object to be moved; given remembered paths, it uses their
        things and those that the instruction names, and is hardly longer than they are.
        """
        if self._bare:
            return grammar([], bare=True)
        said = roles_said(request.instruction, request.scene)
        first = [brief.names[i] for i in said.get("theme", ())]
        if not known:
            return grammar(list(brief.ids), bare=False, first=sorted(first))
        named = {name for path in known for name in path.names}
        first = [path.names[0] for path in known if path.names[0] in first or not first] or first
        named |= {brief.names[i] for ids in said.values() for i in ids} | set(first)
        most = max(len(path.steps) for path in known) + 1
        inside = [name for name in brief.ids if name in named]
        return grammar(inside, bare=False, first=sorted(set(first)), most=most)

    def _ask(
        self, asked: list[Any], brief: SceneBrief, held: str, turn: int
    ) -> tuple[list[Step], tuple[Mapping[str, Any], ...]]:
        config, names = self.config, list(brief.ids)
        warm = max(config.explore, 0.5 if turn else 0.0)
        answered = ask_typed(
            self._language,
            asked,
            lambda text: read_steps(text, brief.ids, bare=self._bare),
            purpose="plan",
            schema=schema(names, bare=self._bare),
            grammar=held,
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
