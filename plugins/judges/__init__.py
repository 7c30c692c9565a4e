"""Judges: which similar lessons in words contradict each other; without one, only typed effects decide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.memory.contracts import Judge


@dataclass(kw_only=True)
class LlmJudgeConfig(ComponentConfig):
    """Options of the ``llm`` judge, which asks the run's ``language``.

    Above ``contradicts`` two lessons contradict each other, below ``agrees`` they do not; in between the pair stays
    open. Each pair is asked in both orders, and the mean counts: models prefer what they read first.
    """

    contradicts: float = 0.7
    agrees: float = 0.35


def _build_llm(config: LlmJudgeConfig, language: LanguageModel) -> Judge:
    """A language model's score tokens, at any OpenAI-compatible address."""
    from gvla2_plugins.judges.language import LlmJudge

    return LlmJudge(config, language)


@hookimpl
def gvla2_judges() -> list[Component[Judge]]:
    """``judge=llm``."""
    return [Component("llm", LlmJudgeConfig, _build_llm, needs=("language",))]
