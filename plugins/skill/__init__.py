"""The skill planners: from words and geometry to waypoints, with or without a model for phrases that fit nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.calls import OPTION_RANGES, SkillOptions

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.planning.contracts import Planner


@dataclass(kw_only=True)
class SkillConfig(SkillOptions, ComponentConfig):
    """Options of the ``skill`` planner: those of :class:`~gvla2.planning.calls.SkillOptions`."""

    def __post_init__(self) -> None:
        check_ranges(self, "planner", OPTION_RANGES)


def _build(config: SkillConfig) -> Planner:
    """Plans by grammar and geometry; needs no language model."""
    from gvla2_plugins.skill.planner import SkillPlanner

    return SkillPlanner(config)


@dataclass(kw_only=True)
class SkillLlmConfig(SkillConfig):
    """Options of the ``skill_llm`` planner: those of ``skill``, and ``sure``, the least sureness in [0, 1] of a model's
    answer that is believed.
    """

    sure: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self, "planner", {"sure": (0.0, 1.0, "")})


def _build_asking(config: SkillLlmConfig, language: LanguageModel) -> Planner:
    """As ``skill``; where no object fits a phrase, a language model says which one it means."""
    from gvla2_plugins.skill.phrases import AskingSkillPlanner

    return AskingSkillPlanner(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """The planners ``skill`` and ``skill_llm``."""
    return [
        Component("skill", SkillConfig, _build),
        Component("skill_llm", SkillLlmConfig, _build_asking, needs=("language",)),
    ]
