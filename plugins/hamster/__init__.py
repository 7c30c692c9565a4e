"""HAMSTER: a vision model draws the hand's path into a picture, depth gives it its third dimension.

After Li et al., "HAMSTER: Hierarchical Action Models for Open-World Robot Manipulation" (2025): asked in its published
words, the model answers with points (x, y) from 0 to 1 and with where the gripper opens and closes. There a learned
policy follows the path; here it is lifted into the scene.
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
class HamsterConfig(PictureOptions, ComponentConfig):
    """Options of the ``hamster`` planner: those of :class:`~gvla2.planning.pictures.PictureOptions`.

    Plus ``travel``, the least height above the table of a carried object, metres.
    """

    travel: float = 0.15

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self, "planner", {"travel": (0, 1, "m")})


def _build(config: HamsterConfig, language: LanguageModel) -> Planner:
    """Plans by a vision model that draws the hand's path into one picture; depth lifts it into the scene."""
    from gvla2_plugins.hamster.planner import HamsterPlanner

    return HamsterPlanner(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """The planner ``hamster``."""
    return [Component("hamster", HamsterConfig, _build, needs=("language",))]
