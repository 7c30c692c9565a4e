"""The views' own measured depth as a geometry prior: the RGB-D input that the paper has but does not use.

Errors can be added to exact depth, to see the effect of a sensor or a network.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import GeometryPrior


@dataclass
class LearnedNoise:
    """Errors of a network's depth of S views; isolate a part by setting the others to 0.

    ``global_scale``: a factor on all depths and poses, drawn within +- this share. ``view_scale`` and ``view_shift``:
    the same for each view by itself; a shift is a share of its median depth. ``low_frequency``: standard deviation of a
    smooth relative error, correlated over ``correlation`` picture widths. ``slope``: depth tilts by up to this share
    from the middle of the object to its rim, in a different direction for each view. ``pose_degrees`` and
    ``pose_shift`` (share of the camera's distance): errors of the cameras that the estimate carries. ``edge_blur``:
    standard deviation in pixels by which depth mixes with what lies behind it. ``outliers``: share of the picture under
    round patches that lie up to ``outlier_size`` off. ``confidence``: 0 reports the error's true size, 1 is right only
    half of the time.
    """

    global_scale: float = 0.3
    view_scale: float = 0.0
    view_shift: float = 0.0
    low_frequency: float = 0.01
    correlation: float = 0.1
    slope: float = 0.0
    pose_degrees: float = 1.0
    pose_shift: float = 0.01
    edge_blur: float = 1.0
    outliers: float = 0.0
    outlier_size: float = 0.15
    confidence: float = 0.5


@dataclass
class DepthPriorConfig(ComponentConfig):
    """Options of the ``depth`` prior.

    ``erode``: width in pixels of the border of measured areas and of the mask, where depth may mix two surfaces.
    ``noise``: ``exact``, the depth unchanged; ``sensor``, as a time-of-flight camera measures it; ``learned``, as a
    network predicts it. ``seed`` of the noise, together with the cameras: one draw per object. ``sensor_sigma``:
    standard deviation of a sensor's depth, metres (L515 by its data sheet), plus ``sensor_relative``, a share of the
    depth; ``sensor_dropout``: share of pixels that it loses. ``learned``: a network's errors, part by part.
    """

    erode: int = 1
    noise: str = "exact"
    seed: int = 0
    sensor_sigma: float = 0.0009
    sensor_relative: float = 0.0016
    sensor_dropout: float = 0.01
    learned: LearnedNoise = field(default_factory=LearnedNoise)


def _build(config: DepthPriorConfig) -> GeometryPrior:
    """Takes the views' measured depth; none without RGB-D views."""
    from gvla2_plugins.depth_prior.prior import DepthPrior

    return DepthPrior(config)


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=depth``."""
    return [Component("depth", DepthPriorConfig, _build)]
