"""VoxPoser: a language model writes value maps over the workspace, and a planner finds the way through them. After
Huang et al., "VoxPoser: Composable 3D Value Maps for Robotic Manipulation with Language Models" (2023).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges
from gvla2.planning.calls import OPTION_RANGES

if TYPE_CHECKING:
    from gvla2.language import LanguageModel
    from gvla2.planning.contracts import Planner

COST = (0.001, 1_000_000, "")
# Finer voxels than a centimetre take seconds for each move.
RANGES = {"voxel": (0.01, 0.2, "m"), "margin": (0.001, 1, "m"), "obstacles": COST, "avoidance": COST}


@dataclass(kw_only=True)
class VoxPoserConfig(ComponentConfig):
    """Options of the ``voxposer`` planner; the run's ``language`` writes the maps.

    ``voxel`` is the grid's step in metres. Touching an obstacle costs ``obstacles`` times the path length, decreasing
    within ``margin`` metres, and full avoidance ``avoidance`` times. There are ``tries`` answers in all.
    """

    voxel: float = 0.02
    obstacles: float = 20.0
    margin: float = 0.04
    avoidance: float = 20.0
    tries: int = 3

    def __post_init__(self) -> None:
        check_ranges(self, "planner", {**OPTION_RANGES, **RANGES})


def _build(config: VoxPoserConfig, language: LanguageModel) -> Planner:
    """Plans by value maps that a language model writes, and the cheapest way through them."""
    from gvla2_plugins.voxposer.planner import VoxPoserPlanner

    return VoxPoserPlanner(config, language)


@hookimpl
def gvla2_planners() -> list[Component[Planner]]:
    """The planner ``voxposer``."""
    return [Component("voxposer", VoxPoserConfig, _build, needs=("language",))]
