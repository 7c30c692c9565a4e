"""VGGT as a geometry prior: depth, confidence and cameras of all views from one forward pass.

Visual Geometry Grounded Transformer (Wang et al., CVPR 2025). Neither the package ``vggt`` nor its weights come with
gvla2: the package is installed from its authors' repository, github.com/facebookresearch/vggt; the weights, VGGT-1B,
are CC-BY-NC-4.0: not for commercial use. Only local files are read, nothing is fetched.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import GeometryPrior


@dataclass
class VggtPriorConfig(ComponentConfig):
    """Options of the ``vggt`` prior."""

    weights: str = ""
    """The checkpoint: ``model.pt``, ``model.safetensors``, or the folder that holds one of them."""
    device: str = ""
    """``cpu``, ``cuda``, ``cuda:1``; empty for the GPU if there is one."""
    width: int = 518
    """Width of the network's input in pixels, a multiple of 14; the height follows the views' shape."""


def _build(config: VggtPriorConfig) -> GeometryPrior:
    """Predicts depth and cameras by VGGT (bring your own weights, non-commercial licence)."""
    from gvla2_plugins.vggt_prior.prior import VggtPrior

    return VggtPrior(config)


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=vggt prior.weights=FOLDER``."""
    return [Component("vggt", VggtPriorConfig, _build)]
