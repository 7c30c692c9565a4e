"""``perceiver=sam``: a segmentation model prompted from geometry, its masks fused over the views in 3D.

After the affordance segmentation module of GeneralVLA (Kirillov et al., "Segment Anything"; Ravi et al., "SAM 2").
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.perception.options import NamingOptions

if TYPE_CHECKING:
    from gvla2.planning.contracts import Perceiver


@dataclass
class SamConfig(NamingOptions, ComponentConfig):
    """Options of the ``sam`` perceiver.

    ``weights``: a folder with one encoder and one decoder of SAM 2 as ONNX. ``min_points``: fewer pixels, over all
    views, are a speck. ``min_height``: what rises less is table, metres; more where depth is noisy. ``min_score``:
    masks with a lower score are replaced by what is connected in 3D. ``localize``: whether ``vision`` is asked to click
    at what the instruction means, five rounds at most.
    """

    weights: str = ""
    min_points: int = 14
    min_height: float = 0.004
    min_score: float = 0.5
    localize: bool = False


def _build(config: SamConfig) -> Perceiver:
    """SAM 2 by ONNX Runtime, prompted by what is connected in 3D; needs weights."""
    from gvla2_plugins.sam.perceiver import SamPerceiver

    return SamPerceiver(config)


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceiver ``sam``."""
    return [Component("sam", SamConfig, _build)]
