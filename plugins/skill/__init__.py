"""The skill planner: from words and geometry to waypoints, without a language model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.calls import OPTION_RANGES

if TYPE_CHECKING:
    from gvla2.planning.contracts import Planner


@dataclass
class SkillConfig(ComponentConfig):
    """Options of the ``skill`` planner: metres, m/s.

    ``lift_height`` is how far an object is lifted when the sentence gives no amount; ``push_distance`` how far it
    is pushed when the sentence gives a direction only; ``speed`` of the tool in the open, ``contact_speed`` where
    it touches. ``tries`` bounds how many candidates are checked in full. ``explore`` > 0 varies the
    numbers of each plan about what they would be, by this relative spread and never by more than half, for episodes
    that gather experience; ``explore_seed`` gives other variations of the same scene.
    """

    lift_height: float = 0.25
    push_distance: float = 0.10
    speed: float = 0.25
    contact_speed: float = 0.08
    tries: int = 16
    explore: float = 0.0
    explore_seed: int = 0

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
