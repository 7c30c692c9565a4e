"""RoboPoint: a vision model points at objects and places in a picture, and a skill does the rest.

After Yuan et al., "RoboPoint: A Vision-Language Model for Spatial Affordance Prediction for Robotics" (2024): asked in
its published words, the model answers with points [(x, y), ...] from 0 to 1. Any model that can point works.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges

if TYPE_CHECKING:
    from gvla2.language import LanguageModel
    from gvla2.planning.contracts import Planner

RANGES = {
    "longest": (64, 4096, "pixels"),  # below, details are lost; above, servers refuse
    "scale": (0.001, 1_000_000, ""),
    "tries": (1, 1000, ""),
}


@dataclass(kw_only=True)
class RoboPointConfig(ComponentConfig):
    """Options of the ``robopoint`` planner; the run's ``language`` must accept images.

    The first camera's picture is shown. ``scale`` is the range of the model's coordinates: 1 as published, 1000 for
    Qwen3-VL or Gemini. The picture's longer side is at most ``longest`` pixels. After an unusable answer the model is
    asked again, with the reason, ``tries`` times in all.
    """

    scale: float = 1.0
    longest: int = 1024
    tries: int = 3

    def __post_init__(self) -> None:
        check_ranges(self, "planner", RANGES)


def _build(config: RoboPointConfig, language: LanguageModel) -> Planner:
    """Plans by a vision model that points at what to take and where to put it; skills carry it out."""
    from gvla2_plugins.robopoint.planner import RoboPointPlanner

    return RoboPointPlanner(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """The planner ``robopoint``."""
    return [Component("robopoint", RoboPointConfig, _build, needs=("language",))]
