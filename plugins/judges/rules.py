"""The judge without a model: it dismisses a suspicion, or leaves it open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.memory.contracts import Judgement, Suspects
from gvla2.memory.meaning.suspicion import suspicion

if TYPE_CHECKING:
    from gvla2_plugins.judges import RulesJudgeConfig

NAME = "rules"


class RulesJudge:
    """Compares both lessons again with all their present tasks.

    It never finds a contradiction: rules on free text err too often to archive a lesson. It reads only English.
    """

    def __init__(self, config: RulesJudgeConfig) -> None:
        if not 0.0 <= config.dismiss <= 1.0:
            raise ConfigurationError(f"dismiss is {config.dismiss}; it must lie in [0, 1].")
        self._dismiss = config.dismiss

    def judge(self, suspects: Sequence[Suspects]) -> Sequence[Judgement]:
        """Dismissed, or left open."""
        return [self._one(pair) for pair in suspects]

    def _one(self, pair: Suspects) -> Judgement:
        found = suspicion(pair.first, pair.second, pair.first_query, pair.second_query)
        if found is None:
            return Judgement(None, pair.suspicion, "these rules only read English", NAME)
        if found < self._dismiss:
            return Judgement(False, found, "read again, with all their tasks, they agree", NAME)
        return Judgement(None, found, "rules cannot tell for sure", NAME)
