"""Inducers: how an episode becomes candidate lessons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.memory.contracts import Inducer


@dataclass
class RulesConfig(ComponentConfig):
    """The ``rules`` inducer has no options."""


@dataclass
class LanguageConfig(ComponentConfig):
    """Options of the ``llm`` inducer, which asks the run's ``language``.

    At most ``most`` lessons are taken from an answer; the first ``transcript`` characters of an episode's transcript
    are shown to the model.
    """

    most: int = 4
    transcript: int = 8000


def _build_rules(config: RulesConfig) -> Inducer:
    """The episode's own lessons, else its steps or what went wrong; deterministic, no language model."""
    from gvla2.memory.induction import RulesInducer

    return RulesInducer()


def _build_language(config: LanguageConfig, language: LanguageModel) -> Inducer:
    """Lessons worded by a language model; by rules if it cannot answer."""
    from gvla2_plugins.inducers.language import LanguageInducer

    return LanguageInducer(config, language)


@hookimpl
def gvla2_inducers() -> list[Component[Inducer]]:
    """Induction by rules, and by a language model."""
    return [
        Component("rules", RulesConfig, _build_rules),
        Component("llm", LanguageConfig, _build_language, needs=("language",)),
    ]
