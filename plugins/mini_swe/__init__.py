"""The ``mini_swe`` agent: mini-swe-agent (MIT) with its own loop and prompts, at the run's ``language``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.agents.contracts import Agent
    from gvla2.language.contracts import LanguageModel


@dataclass(kw_only=True)
class MiniSweConfig(ComponentConfig):
    """Options of the ``mini_swe`` agent.

    It stops after ``steps`` commands; each may take ``command_seconds``. ``temperature`` and ``max_tokens`` apply to
    each answer; null leaves them to the ``language``.
    """

    steps: int = 20
    command_seconds: float = 30.0
    temperature: float | None = None
    max_tokens: int | None = 1024

    def __post_init__(self) -> None:
        if self.steps < 1 or self.command_seconds <= 0:
            raise ConfigurationError("mini_swe needs steps >= 1 and command_seconds > 0.")


def _build(config: MiniSweConfig, language: LanguageModel) -> Agent:
    """mini-swe-agent 2.4: a bash command per answer, until it submits."""
    from gvla2_plugins.mini_swe.agent import MiniSwe

    return MiniSwe(config, language)


@hookimpl
def gvla2_agents() -> list[Component[Agent]]:
    """``agent=mini_swe``."""
    return [Component("mini_swe", MiniSweConfig, _build, needs=("language",))]
