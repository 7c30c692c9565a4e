"""``perceiver=sam``: a segmentation model prompted from geometry, its masks fused over the views in 3D.

After the affordance segmentation module of GeneralVLA (Kirillov et al., "Segment Anything"; Ravi et al., "SAM 2").
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.perception.options import NamingOptions

if TYPE_CHECKING:
    from gvla2.planning.contracts import Perceiver

SAM2_TINY = {
    "sam2_hiera_tiny_encoder.with_runtime_opt.ort": "54e9ee80bd43e36da6c7cd33031a525bb1d70577eadb31190a28999250b13dfe",
    "sam2_hiera_tiny_decoder_pr1.onnx": "4a4c8a8a53d9722834b66d8ced88770e2cc783e367965ba62a13be3ab5f1ba89",
}
"""SHA-256 of the files that ``scripts/fetch_sam`` brings."""


@dataclass
class SamConfig(NamingOptions, ComponentConfig):
    """Options of the ``sam`` perceiver.

    ``weights``: a folder with one encoder and one decoder of SAM 2 as ONNX. ``sha256``: hashes of the files by their
    names; files that it does not name are not checked. ``threads``: of one encode, 0 for all cores.

    ``min_points``: fewer pixels, over all views, are a speck. ``min_height``: what rises less is table, metres; more
    where depth is noisy. ``min_score``: masks with a lower score are replaced by what is connected in 3D.
    ``localize``: whether ``vision`` is asked to click at what the instruction means, five rounds at most.
    """

    weights: str = ""
    sha256: dict[str, str] = field(default_factory=lambda: dict(SAM2_TINY))
    threads: int = 0
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
