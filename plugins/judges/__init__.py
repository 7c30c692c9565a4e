"""Judges: which similar lessons in words contradict each other; without one, only typed effects decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from statistics import fmean

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import ConfigurationError
from gvla2.language import Completion, LanguageModel, LanguageModelError, Message, Request
from gvla2.language.score_tokens import reason_of, score_answer
from gvla2.memory.contracts import Judge, Judgement, LessonPair
from gvla2.memory.rendering import neutralised

NAME = "llm"
LONGEST, LONGEST_TASK, LONGEST_REASON = 1200, 400, 200


@dataclass(kw_only=True)
class LlmJudgeConfig(ComponentConfig):
    """Options of the ``llm`` judge, which asks the run's ``language``.

    Above ``contradicts`` two lessons contradict each other, below ``agrees`` they do not; in between the pair stays
    open. Each pair is asked in both orders, and the mean counts: models prefer what they read first.
    """

    contradicts: float = 0.7
    agrees: float = 0.35

    def __post_init__(self) -> None:
        if not 0.0 <= self.agrees < self.contradicts <= 1.0:
            raise ConfigurationError(
                f"agrees is {self.agrees} and contradicts {self.contradicts}; they must lie in [0, 1], agrees below "
                "contradicts."
            )


class LlmJudge:
    """A language model's score tokens, at any OpenAI-compatible address."""

    def __init__(self, config: LlmJudgeConfig, language: LanguageModel) -> None:
        self._config, self._language = config, language
        self._orders = files(__package__).joinpath("prompt.md").read_text("utf-8").strip()

    def judge(self, pairs: Sequence[LessonPair]) -> Sequence[Judgement]:
        """A judgement per pair; failed requests are left open, with the reason."""
        asked = [self._messages(pair, turned) for pair in pairs for turned in (False, True)]
        requests = [Request(messages, logprobs=True, seed=0) for messages in asked]
        answers = self._language.complete_all(requests, purpose="judge") if requests else []
        return [self._judgement(answers[i : i + 2]) for i in range(0, len(answers), 2)]

    def _judgement(self, given: Sequence[Completion | LanguageModelError]) -> Judgement:
        answers = [answer for answer in given if isinstance(answer, Completion)]
        failed = next((str(answer) for answer in given if not isinstance(answer, Completion)), "")
        if failed:
            return Judgement(None, 0.5, f"The model could not be asked: {failed}", NAME)
        scores = [score_answer(answer.text, answer.tokens) for answer in answers]
        if any(score.source == "midpoint" for score in scores):
            return Judgement(None, 0.5, "The model gave no valid score.", NAME)
        probability, mass = (
            fmean(values) for values in zip(*((s.value, s.mass) for s in scores), strict=True)
        )
        sure = probability >= self._config.contradicts or probability <= self._config.agrees
        said = neutralised(f"{reason_of(answers[0].text)} (mass {mass:.2f})", LONGEST_REASON)
        return Judgement(probability >= self._config.contradicts if sure else None, probability, said, NAME)

    def _messages(self, pair: LessonPair, turned: bool) -> list[Message]:
        sides = [(pair.first, pair.first_query), (pair.second, pair.second_query)]
        lines = []
        for name, (text, query) in zip("12", reversed(sides) if turned else sides, strict=True):
            task = neutralised(query.replace("\n", " / "), LONGEST_TASK)
            lines.append(f"{name}. {neutralised(text, LONGEST)}" + (f" (learned in: {task})" if task else ""))
        shown = "\n".join(["<lessons>", *lines, "</lessons>"])
        return [{"role": "system", "content": self._orders}, {"role": "user", "content": shown}]


@hookimpl
def gvla2_judges() -> list[Component[Judge]]:
    """``judge=llm``."""
    return [Component("llm", LlmJudgeConfig, LlmJudge, needs=("language",))]
