"""Plans from a language model: ask, read, plan, check, and ask again with the reasons for a refusal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from gvla2.errors import PlanningError
from gvla2.language import LanguageModel, Message, UnusableAnswerError, ask_typed
from gvla2.planning.contracts import Abstention, Plan, PlanRequest, RefusedError
from gvla2.planning.programs import Language, Program, adapted
from gvla2.planning.scene_brief import scene_brief

MAX_CHARACTERS = 1000
"""Maximum number of characters of an instruction, and of the reasons against an answer, in a prompt."""


def nothing_to_ask(request: PlanRequest) -> Plan | None:
    """The refusal of a request for which no model has to be asked; None for any other."""
    refusal = None
    if not request.instruction.strip():
        refusal = Abstention("unknown_skill", "The instruction is empty; say what to do.")
    elif (length := len(_one_line(request.instruction))) > MAX_CHARACTERS:
        limit = f"a prompt holds at most {MAX_CHARACTERS}. Shorten it."
        refusal = Abstention("other", f"The instruction has {length} characters; {limit}")
    elif not request.scene.objects:
        refusal = Abstention("nothing_matches", "No object was perceived that could be handled.")
    return None if refusal is None else Plan(None, abstention=refusal)


def _one_line(text: str) -> str:
    return " ".join(text.split())


class Question:
    """A request as a model is asked about it: objects by the names of a brief, texts on one line.

    ``positions``: whether the brief has the objects' places. ``instruction`` is the request's; ``rejection`` says what
    the checks found wrong with the planner's last answer, "" on a first try.
    """

    def __init__(self, request: PlanRequest, *, positions: bool = True) -> None:
        self.request, self.brief = request, scene_brief(request.scene, positions=positions)
        self.instruction = _one_line(request.instruction)
        reasons = " ".join(map(self._named, request.rejections))[:MAX_CHARACTERS]
        self.rejection = f"An earlier plan was rejected: {reasons}" if reasons else ""

    def _named(self, reason: str) -> str:
        return self.brief.named(reason, self.request.scene)

    def remembered(self, language: Language) -> Iterator[tuple[Program, str, tuple[Any, ...]]]:
        """Memory's programs in a ``language``, best first: each with its instruction, and its steps in the names and
        millimetres of this scene. Those with a role for which no object fits are left out.
        """
        request = self.request
        for program in request.advice.programs:
            if program.language == language:
                steps = adapted(program, request.scene, self.brief.names, request.instruction)
                if steps is not None:
                    yield program, _one_line(program.instruction), steps

    def ask(
        self,
        language: LanguageModel,
        messages: Sequence[Message],
        plan_of: Callable[[str], Plan],
        *,
        tries: int,
        **asking: Any,
    ) -> Plan:
        """The plan that ``plan_of`` makes of an answer to ``messages``.

        An answer for which ``plan_of`` raises :class:`ValueError`, or abstains, goes back to the model with the reason
        (in the brief's names), ``tries`` times in all; then the plan is an abstention with the last reason.
        :class:`~gvla2.planning.contracts.RefusedError` ends the conversation. ``asking`` are further arguments of
        :func:`~gvla2.language.ask_typed`. Raises :class:`~gvla2.language.LanguageModelError` if no model answers.
        """
        refused: dict[str, Abstention] = {}

        def parse(text: str) -> Plan:
            try:
                plan = plan_of(text)
            except RefusedError as declined:
                return Plan(None, abstention=declined.abstention)
            except PlanningError as error:
                raise ValueError(str(error)) from None
            if plan.abstention is not None:
                reason = self._named(plan.abstention.message)
                refused[reason] = plan.abstention
                raise ValueError(reason)
            return plan

        try:
            found = ask_typed(language, messages, parse, purpose="plan", tries=tries, **asking)
        except UnusableAnswerError as error:
            last = [abstention for reason, abstention in refused.items() if reason in str(error)]
            why = last[-1] if last else Abstention("other", str(error))
            return Plan(None, abstention=why, transcript=error.transcript)
        return replace(found.answer, transcript=(*found.transcript, *found.answer.transcript))
