"""RoboPoint: a vision model points at objects and places in a picture, and a skill does the rest.

After Yuan et al., "RoboPoint: A Vision-Language Model for Spatial Affordance Prediction for Robotics" (2024): asked in
its published words, the model answers with points [(x, y), ...] from 0 to 1. Any model that can point works.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.pictures import PictureOptions

if TYPE_CHECKING:
    from gvla2.language import LanguageModel
    from gvla2.planning.contracts import Planner


@dataclass(kw_only=True)
class RoboPointConfig(PictureOptions, ComponentConfig):
    """Options of the ``robopoint`` planner: those of :class:`~gvla2.planning.pictures.PictureOptions`.

    And ``agreement``, the share of points that must lie on one object to select it.
    """

    agreement: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self, "planner", {"agreement": (0.001, 1, "")})


def _build(config: RoboPointConfig, language: LanguageModel) -> Planner:
    """Plans by a vision model that points at what to take and where to put it; skills carry it out."""
    from gvla2_plugins.robopoint.planner import RoboPointPlanner

    return RoboPointPlanner(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """The planner ``robopoint``."""
    return [Component("robopoint", RoboPointConfig, _build, needs=("language",))]
