"""The views' own measured depth as a geometry prior: the RGB-D setting that the paper has and leaves unused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import GeometryPrior


@dataclass
class DepthPriorConfig(ComponentConfig):
    """Options of the ``depth`` prior."""

    erode: int = 1
    """Width in pixels of the border, of what was measured and of the mask, where depth may be a mixture of two."""
    slope: float = 4.0
    """Border pixels are kept when their depth differs from the nearest inner pixel's by less than this slope,
    in pixel sizes a pixel: a surface seen at 76 degrees. 0 leaves the whole border out."""
    confidence: float = 1.0
    """Confidence of every measured pixel, > 0."""


def _build(config: DepthPriorConfig) -> GeometryPrior:
    """Takes the depth that the views measured; none without RGB-D views."""
    from gvla2_plugins.depth_prior.prior import DepthPrior

    return DepthPrior(config)


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=depth``."""
    return [Component("depth", DepthPriorConfig, _build)]
