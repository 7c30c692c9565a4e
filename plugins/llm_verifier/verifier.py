"""All criteria asked at once, one verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from statistics import fmean
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.language import Completion, LanguageModel, LanguageModelError, Request
from gvla2.language.score_tokens import TokenScore, score_answer
from gvla2.memory.contracts import Evidence, Verdict
from gvla2.memory.rendering import neutralised
from gvla2_plugins.llm_verifier.questions import Criterion, criteria_set, messages

if TYPE_CHECKING:
    from gvla2_plugins.llm_verifier import LlmVerifierConfig

NAME = "llm"
LONGEST_REASON = 300


class LlmVerifier:
    """A language model's judgement of an episode's transcript (paper, eq. R_t).

    When any criterion could not be asked, or its answer was lost to reasoning, the verdict is ``unavailable``: a mean
    over the others would be for a different set of criteria, and a midpoint would be invented.
    """

    def __init__(self, config: LlmVerifierConfig, language: LanguageModel) -> None:
        if config.repeats < 1 or config.longest < 200:
            raise ConfigurationError(
                f"repeats is {config.repeats} and longest {config.longest}; they must be at least 1 and 200."
            )
        self._criteria = criteria_set(config.criteria, config.questions)
        self._config, self._language = config, language

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict; ``unavailable`` without a transcript or facts, or when the model could not be asked."""
        if not evidence.transcript.strip() and not evidence.facts:
            return Verdict.unavailable("There is neither a transcript nor a fact to judge.", NAME)
        repeats = self._config.repeats
        requests = [
            Request(
                messages(evidence, criterion, self._config.longest), logprobs=True, seed=self._config.seed + i
            )
            for criterion in self._criteria
            for i in range(repeats)
        ]
        answers = self._language.complete_all(requests, purpose="verify")
        usage = _usage(answers)
        by_criterion = {
            criterion: answers[i * repeats : (i + 1) * repeats] for i, criterion in enumerate(self._criteria)
        }
        failures = dict.fromkeys(
            problem for given in by_criterion.values() for answer in given if (problem := _problem(answer))
        )
        if failures:
            missing = sum(any(map(_problem, given)) for given in by_criterion.values())
            verdict = Verdict.unavailable(
                f"{missing} of {len(self._criteria)} criteria could not be judged: {' '.join(failures)}", NAME
            )
            return replace(verdict, usage=usage)
        return _verdict(by_criterion, usage)


def _problem(answer: Completion | LanguageModelError) -> str:
    """Why this is not an answer, "" if it is one."""
    if isinstance(answer, LanguageModelError):
        return str(answer)
    if answer.text.strip():
        return ""
    if answer.finish == "length" or answer.reasoning:
        return "The model spent all its tokens on reasoning and gave no answer: raise max_tokens."
    return "The model's answer was empty."


def _verdict(
    by_criterion: dict[Criterion, list[Completion | LanguageModelError]], usage: dict[str, int]
) -> Verdict:
    scores: dict[str, float] = {}
    mass: dict[str, float] = {}
    reasons = []
    for criterion, given in by_criterion.items():
        answers = [a for a in given if isinstance(a, Completion)]
        found = [score_answer(a.text, a.tokens) for a in answers]
        scores[criterion.name] = fmean(s.value for s in found)
        mass[criterion.name] = fmean(s.mass for s in found)
        reasons.append(
            f"{criterion.name.replace('_', ' ')} {scores[criterion.name]:.2f} {_how(found, answers)}"
        )
    return replace(Verdict.from_criteria(scores, reasons, NAME), usage=usage, mass=mass)


def _how(found: Sequence[TokenScore], answers: Sequence[Completion]) -> str:
    """The source of a score, and the model's own words for it."""
    mass = f"mass {fmean(s.mass for s in found):.2f}"
    words = {
        "distribution": f"({mass})",
        "tag": f"(the letter as written, {mass})",
        "midpoint": "(no valid score in the answer)",
    }
    text = answers[0].text
    tag = text.lower().rfind("<score>")
    said = neutralised(text[:tag] if tag >= 0 else text, LONGEST_REASON)
    sources = " ".join(words[source] for source in dict.fromkeys(s.source for s in found))
    return f"{sources}: {said}" if said else sources


def _usage(answers: Sequence[Completion | LanguageModelError]) -> dict[str, int]:
    """The cost of this verdict: cached answers are counted as such, without their tokens."""
    given = [a for a in answers if isinstance(a, Completion)]
    paid = [a for a in given if not a.cached]
    return {
        "prompt_tokens": sum(a.usage.prompt_tokens for a in paid),
        "completion_tokens": sum(a.usage.completion_tokens for a in paid),
        "calls": len(paid),
        "cached": len(given) - len(paid),
        "unmetered": sum(not a.usage.metered for a in paid),
    }
