"""The views' own measured depth as a geometry prior: the RGB-D input that the paper has but does not use.

Errors can be added to exact depth, to see the effect of a sensor or a network.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2_plugins.depth_prior.noise import LearnedNoise

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import GeometryPrior


@dataclass
class DepthPriorConfig(ComponentConfig):
    """Options of the ``depth`` prior."""

    erode: int = 1
    """Width in pixels of the border of measured areas and of the mask, where depth may mix two surfaces."""
    slope: float = 4.0
    """Border pixels are kept when their depth differs from the nearest inner pixel's by less than this slope, in pixel
    sizes per pixel: a surface seen at 76 degrees. 0 drops the whole border."""
    confidence: float = 1.0
    """Confidence of every measured pixel, > 0."""
    noise: str = "exact"
    """``exact``: the depth unchanged; ``sensor``: as a time-of-flight camera measures it; ``learned``: as a network
    predicts it."""
    seed: int = 0
    """Seed of the noise, together with the cameras: one draw per object."""
    sensor_sigma: float = 0.0009
    """Standard deviation of a sensor's depth, metres (L515 by its data sheet), plus ..."""
    sensor_relative: float = 0.0016
    """... this share of the depth."""
    sensor_dropout: float = 0.01
    """Share of pixels that a sensor loses."""
    learned: LearnedNoise = field(default_factory=LearnedNoise)
    """A network's depth errors, part by part."""


def _build(config: DepthPriorConfig) -> GeometryPrior:
    """Takes the views' measured depth; none without RGB-D views."""
    from gvla2_plugins.depth_prior.prior import DepthPrior

    return DepthPrior(config)


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=depth``."""
    return [Component("depth", DepthPriorConfig, _build)]
