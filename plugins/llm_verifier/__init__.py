"""The ``llm`` verifier: a language model judges the episode's transcript, criterion by criterion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.memory.contracts import Verifier


@dataclass(kw_only=True)
class LlmVerifierConfig(ComponentConfig):
    """Options of the ``llm`` verifier, which asks the run's ``language``.

    ``criteria`` is a set, ``robot`` or ``software``; ``questions`` (name: question) are used instead if given.
    Transcripts are cut in the middle to ``longest`` characters.
    """

    criteria: str = "robot"
    questions: dict[str, str] = field(default_factory=dict)
    longest: int = 24_000


def _build(config: LlmVerifierConfig, language: LanguageModel) -> Verifier:
    """Judges transcripts by a language model's score tokens, at any OpenAI-compatible address."""
    from gvla2_plugins.llm_verifier.verifier import LlmVerifier

    return LlmVerifier(config, language)


@hookimpl
def gvla2_verifiers() -> list[Component[Verifier]]:
    """``verifier=llm``."""
    return [Component("llm", LlmVerifierConfig, _build, needs=("language",))]
