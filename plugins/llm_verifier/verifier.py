"""The verifier that asks a language model: the paper's criteria, all asked at once, one verdict.

The episode is data in the prompt: nothing in it can act as markup or imitate the prompt's own.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError, did_you_mean
from gvla2.language import Completion, LanguageModel, LanguageModelError, Request
from gvla2.language.score_tokens import reason_of, score_answer
from gvla2.memory.contracts import Evidence, Verdict
from gvla2.memory.rendering import neutralised

if TYPE_CHECKING:
    from gvla2_plugins.llm_verifier import LlmVerifierConfig

NAME = "llm"
LONGEST_REASON = 300
_LONGEST_INSTRUCTION = 2_000
_LONGEST_FACTS = 4_000


def criteria_set(name: str, questions: Mapping[str, str] | None = None) -> Mapping[str, str]:
    """The questions by name of that set of ``criteria.toml``; or the user's own ``questions`` if given.

    Raises :class:`ConfigurationError` for an unknown set, or an empty name or question.
    """
    if questions:
        if not all(key.strip() and question.strip() for key, question in questions.items()):
            raise ConfigurationError("A criterion of your own needs a name and a question; one is empty.")
        return questions
    sets = tomllib.loads(files(__package__).joinpath("criteria.toml").read_text("utf-8"))
    if name not in sets:
        hint = did_you_mean(name, sets)
        raise ConfigurationError(f"No set of criteria is called '{name}'.{hint} Sets: {', '.join(sets)}.")
    found: Mapping[str, str] = sets[name]
    return found


def as_data(text: str, longest: int) -> str:
    """``text`` without anything that a prompt or a chat template could treat as markup; line breaks stay.

    A long one keeps its head and tail: the end, with its outcome, is worth as much as the beginning.
    """
    if len(text) > longest:
        note = f"\n({len(text) - longest} characters left out)\n"
        room = max(longest - len(note), 0)
        text = text[: room // 2] + note + text[len(text) - (room - room // 2) :]
    lines = (neutralised(line, longest) for line in text.splitlines())
    return "\n".join(filter(None, lines))[:longest]


class LlmVerifier:
    """A language model's judgement of an episode's transcript (paper, eq. R_t).

    When any criterion could not be asked, or its answer was lost to reasoning, the verdict is ``unavailable``: a mean
    over the others would be for a different set of criteria, and a midpoint would be invented.
    """

    def __init__(self, config: LlmVerifierConfig, language: LanguageModel) -> None:
        if config.longest < 200:
            raise ConfigurationError(f"longest is {config.longest}; it must be at least 200.")
        self._criteria = criteria_set(config.criteria, config.questions)
        self._orders = files(__package__).joinpath("prompt.md").read_text("utf-8").strip()
        self._longest, self._language = config.longest, language

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict; ``unavailable`` without a transcript or facts, or when the model could not be asked."""
        if not evidence.transcript.strip() and not evidence.facts:
            return Verdict.unavailable("There is neither a transcript nor a fact to judge.", NAME)
        asked = [self._messages(evidence, *criterion) for criterion in self._criteria.items()]
        requests = [Request(messages, logprobs=True, seed=0) for messages in asked]
        answers = self._language.complete_all(requests, purpose="verify")
        if problems := [problem for answer in answers if (problem := _problem(answer))]:
            failed = f"{len(problems)} of {len(self._criteria)} criteria could not be judged"
            return Verdict.unavailable(f"{failed}: {' '.join(dict.fromkeys(problems))}", NAME)
        scores, reasons = dict[str, float](), []
        for name, answer in zip(self._criteria, answers, strict=True):
            assert isinstance(answer, Completion)  # else it was a problem
            found = score_answer(answer.text, answer.tokens)
            scores[name] = found.value
            said = neutralised(reason_of(answer.text), LONGEST_REASON)
            score = f"{name.replace('_', ' ')} {found.value:.2f} ({found.source}, mass {found.mass:.2f})"
            reasons.append(score + (f": {said}" if said else ""))
        return Verdict.from_criteria(scores, reasons, NAME)

    def _messages(self, evidence: Evidence, name: str, question: str) -> list[dict[str, str]]:
        """The conversation that asks for one criterion's score.

        The episode comes before the criterion: a server that caches prompt prefixes then reads it once.
        """
        facts = json.dumps(dict(evidence.facts), ensure_ascii=False, default=str, skipkeys=True)
        parts = [
            f"Instruction to the agent: {as_data(evidence.instruction, _LONGEST_INSTRUCTION)}",
            f"Observed facts: {as_data(facts, _LONGEST_FACTS)}" if evidence.facts else "",
            f"Transcript:\n{as_data(evidence.transcript, self._longest) or '(empty)'}",
        ]
        episode = "\n".join(filter(None, parts))
        asked = f"<episode>\n{episode}\n</episode>\n\nCriterion: {name.replace('_', ' ')}. {question}"
        return [{"role": "system", "content": self._orders}, {"role": "user", "content": asked}]


def _problem(answer: Completion | LanguageModelError) -> str:
    """Why this is not an answer, "" if it is one."""
    if isinstance(answer, LanguageModelError):
        return str(answer)
    if answer.text.strip():
        return ""
    if answer.finish == "length":
        return "The model spent all its tokens on reasoning and gave no answer: raise max_tokens."
    return "The model's answer was empty."
