"""The judge that asks a language model, by the score tokens that the verifier uses."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from statistics import fmean
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.language import Completion, LanguageModel, LanguageModelError, Message, Request
from gvla2.language.score_tokens import TokenScore, score_answer
from gvla2.memory.contracts import Judgement, LessonPair
from gvla2.memory.rendering import neutralised

if TYPE_CHECKING:
    from gvla2_plugins.judges import LlmJudgeConfig

NAME = "llm"
LONGEST, LONGEST_TASK, LONGEST_REASON = 1200, 400, 200
_ORDERS = files(__package__).joinpath("prompt.md").read_text("utf-8").strip()


class LlmJudge:
    """A language model's judgement of pairs of lessons."""

    def __init__(self, config: LlmJudgeConfig, language: LanguageModel) -> None:
        if not 0.0 <= config.agrees < config.contradicts <= 1.0:
            raise ConfigurationError(
                f"agrees is {config.agrees} and contradicts {config.contradicts}; they must lie in [0, 1], agrees "
                "below contradicts."
            )
        self._config, self._language = config, language

    def judge(self, pairs: Sequence[LessonPair]) -> Sequence[Judgement]:
        """A judgement per pair; failed requests are left open, with the reason."""
        asked = [_messages(pair, turned) for pair in pairs for turned in (False, True)]
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
        probability = fmean(score.value for score in scores)
        return Judgement(self._decision(probability), probability, _reason(answers, scores), NAME)

    def _decision(self, probability: float) -> bool | None:
        if probability >= self._config.contradicts:
            return True
        return False if probability <= self._config.agrees else None


def _messages(pair: LessonPair, turned: bool) -> list[Message]:
    sides = [(pair.first, pair.first_query), (pair.second, pair.second_query)]
    lines = []
    for name, (text, query) in zip("12", reversed(sides) if turned else sides, strict=True):
        task = neutralised(query.replace("\n", " / "), LONGEST_TASK)
        lines.append(f"{name}. {neutralised(text, LONGEST)}" + (f" (learned in: {task})" if task else ""))
    shown = "\n".join(["<lessons>", *lines, "</lessons>"])
    return [{"role": "system", "content": _ORDERS}, {"role": "user", "content": shown}]


def _reason(answers: Sequence[Completion], scores: Sequence[TokenScore]) -> str:
    text = answers[0].text
    said = neutralised(text[: max(text.lower().rfind("<score>"), 0)], LONGEST_REASON)
    mass = fmean(score.mass for score in scores)
    return f"{said} (mass {mass:.2f})" if said else f"mass {mass:.2f}"
