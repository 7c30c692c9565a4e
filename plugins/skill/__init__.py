"""The skill planner: from words and geometry to waypoints, without a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.calls import OPTION_RANGES, SkillOptions

if TYPE_CHECKING:
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


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """The planner ``skill``."""
    return [Component("skill", SkillConfig, _build)]
