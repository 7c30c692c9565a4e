"""Inducers: how an episode becomes candidate lessons."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Inducer


@dataclass
class RulesConfig(ComponentConfig):
    """The ``rules`` inducer has no options."""


@dataclass
class LanguageConfig(ComponentConfig):
    """Options of the ``llm`` inducer.

    The first ones say which model to ask, see :class:`gvla2.language.EndpointOptions`. At most ``most`` lessons are
    taken from an answer; the first ``transcript`` characters of an episode's account are shown to the model.
    """

    base_url: str = "http://127.0.0.1:8000/v1"
    model: str = ""
    api_key_env: str = ""
    timeout: float = 60.0
    retries: int = 2
    concurrency: int = 4
    temperature: float | None = 0.0
    max_tokens: int | None = 2048
    cache: str = ""
    extra: dict[str, Any] = field(default_factory=dict)
    most: int = 4
    transcript: int = 8000


def _build_rules(config: RulesConfig) -> Inducer:
    """The episode's own lessons, else its steps or what went wrong; deterministic, no language model."""
    from gvla2.memory.curation.induction import RulesInducer

    return RulesInducer()


def _build_language(config: LanguageConfig) -> Inducer:
    """Lessons worded by a language model; by rules where it cannot answer."""
    from gvla2_plugins.inducers.language import LanguageInducer

    return LanguageInducer(config)


@hookimpl
def gvla2_inducers() -> list[Component[Inducer]]:
    """Induction by rules, and by a language model."""
    return [
        Component("rules", RulesConfig, _build_rules),
        Component("llm", LanguageConfig, _build_language),
    ]
