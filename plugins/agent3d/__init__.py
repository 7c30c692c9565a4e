"""The 3DAgent planner of the paper: a language model writes the waypoints of the hand's path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.calls import OPTION_RANGES

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.planning.contracts import Planner


@dataclass(kw_only=True)
class Agent3dConfig(ComponentConfig):
    """Options of the ``agent3d`` planner, which asks the run's ``language``.

    The model is asked at most ``tries`` times, each time with the reason why its last answer cannot be executed. At
    most ``programs`` remembered successes are shown.
    ``speed`` of the tool in the open, ``contact_speed`` where it touches, m/s. ``explore`` > 0 is the temperature of
    the first answer, to gather experience; ``explore_seed`` varies it.
    """

    tries: int = 3
    programs: int = 2
    max_tokens: int = 400
    speed: float = 0.25
    contact_speed: float = 0.08
    explore: float = 0.0
    explore_seed: int = 0

    def __post_init__(self) -> None:
        check_ranges(self, "planner", OPTION_RANGES)


def _build(config: Agent3dConfig, language: LanguageModel) -> Planner:
    """Plans waypoints relative to named objects by a language model."""
    from gvla2_plugins.agent3d.planner import Agent3d

    return Agent3d(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """``planner=agent3d``."""
    return [Component("agent3d", Agent3dConfig, _build, needs=("language",))]
