"""The planner: brief the model, read its program, ask back where words and program disagree, carry the calls out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gvla2.language import Answered, LanguageModel, UnusableAnswerError, ask_typed
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.programs import calls_program
from gvla2.planning.scene_brief import SceneBrief, scene_brief
from gvla2.programs.faithful import Named, beyond, doubts, named_things, theme_held, unclear
from gvla2.programs.grammar import Fitting, fitting, grammar
from gvla2.programs.interpreter import WHY, Declined, ProgramInterpreter, lines_of
from gvla2.programs.wishes import MOST, most_calls
from gvla2.skills.asked_paths import last_answer, nothing_to_ask
from gvla2.skills.carry_out import carry_out
from gvla2.skills.skill import Skill
from gvla2.skills.table import STANDARD
from gvla2.skills.wording import in_scene_words
from gvla2_plugins.code_policies import CodePoliciesConfig
from gvla2_plugins.code_policies.prompt import correction, messages

BACK = 2
"""So often the reasons why a program cannot be carried out go back to the model."""


@dataclass(frozen=True)
class _Written:
    """A program as it was written and as it was read."""

    calls: tuple[SkillCall, ...]
    text: str
    transcript: tuple[Mapping[str, Any], ...]
    share: float


class CodePolicies:
    """Implements :class:`gvla2.planning.contracts.Planner` by programs that a language model writes."""

    def __init__(self, config: CodePoliciesConfig, language: LanguageModel) -> None:
        self.config = config
        self._language = language
        self._options = SkillOptions(
            lift_height=config.lift_height,
            push_distance=config.push_distance,
            speed=config.speed,
            contact_speed=config.contact_speed,
            explore=config.explore,
            explore_seed=config.explore_seed,
        )

    def plan(self, request: PlanRequest) -> Plan:
        """A plan of the program's first part, the rest with it; or an abstention with all that was said.

        Raises :class:`gvla2.language.LanguageModelError` when the model cannot be asked.
        """
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        if self.config.cautious:
            request = replace(request, instruction=in_scene_words(request.instruction, request.scene))
        skills, brief = request.skills or STANDARD, scene_brief(request.scene)
        can = fitting(request, skills, brief)
        if not can:
            return Plan(None, abstention=Abstention("nothing_matches", "Nothing is there that a skill fits."))
        asked = messages(request, skills, can, brief, self.config.programs)
        if request.rejections:
            why = [brief.named(reason, request.scene) for reason in request.rejections]
            asked += correction(why, last_answer(request.rejected))
        if self.config.cautious and (declined := beyond(request.instruction, request.scene)) is not None:
            return Plan(None, abstention=declined)
        said: tuple[Mapping[str, Any], ...] = ()
        kept: tuple[float, Plan, list[Named]] | None = None
        named: list[Named] = []
        for turn in range(1 + BACK):
            try:
                written = self._ask(asked, request, skills, can, brief, turn, named)
            except UnusableAnswerError as error:
                if not any(entry["answer"] for entry in error.transcript):
                    raise  # nobody is there
                said += tuple(error.transcript)
                break
            said += written.transcript
            plan, doubtful = self._carried_out(written, request, brief, can)
            unclear = plan.abstention is not None and plan.abstention.kind == "ambiguous"
            failed = plan.abstention is not None and bool(written.calls) and not unclear
            against = len(doubtful) + 10.0 * failed
            if kept is None or against < kept[0]:
                kept = against, plan, doubtful
            if not against:
                break
            reasons = [brief.named(plan.abstention.message, request.scene)] if plan.abstention else []
            asked += correction([*reasons, *(d.reason for d in doubtful)], written.text)
            all_named = named_things(request.instruction, request.scene, brief.names)
            handled = [d for d in doubtful if d.handled]
            if len(written.calls) == 1 and doubtful and not handled:
                handled = [theme_held(written.calls[0], request.scene, brief.names)]
            named = [*handled, *all_named]
        if kept is None:
            none = Abstention("other", "The model wrote no program that can be read.")
            return Plan(None, abstention=none, transcript=said)
        return replace(self._heeded(kept[1], kept[2]), transcript=said)

    def _heeded(self, plan: Plan, doubtful: Sequence[Named]) -> Plan:
        """The plan; or, of a cautious planner, a refusal where the program leaves out what the wish names."""
        if plan.abstention is not None or not doubtful or not self.config.cautious:
            return plan
        message = " ".join(["The model's programs do not follow the wish.", *(d.reason for d in doubtful)])
        return replace(plan, trajectory=None, abstention=Abstention("other", message))

    def _ask(
        self,
        asked: list[Any],
        request: PlanRequest,
        skills: Mapping[str, Skill],
        can: Fitting,
        brief: SceneBrief,
        turn: int,
        named: Sequence[Named],
    ) -> _Written:
        def parse(text: str) -> tuple[tuple[SkillCall, ...], str]:
            try:
                return ProgramInterpreter(request.scene, brief.ids, skills).run(text), text.strip()
            except Declined as declined:
                return (), declined.reason

        answered: Answered[tuple[tuple[SkillCall, ...], str]] = ask_typed(
            self._language,
            asked,
            parse,
            purpose="plan",
            grammar=grammar(skills, can, request.instruction, named, most=self._most(request)),
            tries=self.config.tries,
            samples=self.config.samples,
            same=lambda found: repr(found[0]),
            seed=100 * turn,
            temperature=0.5 if turn else None,
            max_tokens=self.config.max_tokens,
        )
        calls, text = answered.answer
        return _Written(calls, text, answered.transcript, answered.votes / answered.samples)

    def _most(self, request: PlanRequest) -> int:
        return most_calls(request.instruction, request.scene) if self.config.cautious else MOST

    def _carried_out(
        self, written: _Written, request: PlanRequest, brief: SceneBrief, can: Fitting
    ) -> tuple[Plan, list[Named]]:
        """The plan of a program, and what makes it doubtful."""
        if written.share < self.config.agreement:
            few = Abstention(
                "ambiguous", f"Only {written.share:.0%} of the model's answers agree on a program."
            )
            return Plan(None, abstention=few), []
        if not written.calls:
            return Plan(None, abstention=Abstention(*WHY[written.text])), []
        able = {brief.ids[name] for name in can.get(written.calls[0].skill, {})}
        if several := unclear(written.calls, request.instruction, request.scene, able):
            return Plan(None, abstention=Abstention("ambiguous", several)), []
        doubtful = doubts(written.calls, request.instruction, request.scene, brief.names)
        plan = carry_out(written.calls, request, self._options)
        if plan.abstention is not None:
            return plan, doubtful
        program = calls_program(
            lines_of(written.text), brief.ids, request.scene, roles=plan.roles, skill=plan.skill,
            instruction=request.instruction,
        )  # fmt: skip
        return replace(plan, program=program), doubtful
