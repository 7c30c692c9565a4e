"""Noise of depth cameras, put on clean observations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation, View, Views


@dataclass(frozen=True)
class DepthNoise:
    """Independent noise of each pixel.

    The deviation at a depth of d metres is ``sigma_m`` + ``sigma_rel`` * d metres; ``dropout`` is the share of
    pixels in [0, 1] that measure nothing; ``kind`` is what this noise is called, a name for people.
    Raises :class:`ConfigurationError` for values out of range.
    """

    kind: str = "none"
    sigma_m: float = 0.0
    sigma_rel: float = 0.0
    dropout: float = 0.0

    def __post_init__(self) -> None:
        if not (self.sigma_m >= 0 and self.sigma_rel >= 0 and 0 <= self.dropout <= 1):
            raise ConfigurationError(
                "Depth noise needs deviations >= 0 and a dropout in [0, 1], got "
                f"sigma_m={self.sigma_m}, sigma_rel={self.sigma_rel}, dropout={self.dropout}."
            )


def apply_noise(observation: Observation, noise: DepthNoise, rng: np.random.Generator) -> Observation:
    """A copy of the observation with noise on every view's depth; its other data are shared, not copied.

    NaN stays NaN, a depth pushed to zero or below becomes NaN, lost pixels become NaN. Robot masks stay: they
    come from the joints.
    """
    views = tuple(_disturb(view, noise, rng) for view in observation.views)
    return replace(observation, views=Views(views))


def _disturb(view: View, noise: DepthNoise, rng: np.random.Generator) -> View:
    if view.depth is None:
        return view
    depth: NDArray[np.float64] = view.depth.astype(np.float64)
    depth = depth + rng.standard_normal(depth.shape) * (noise.sigma_m + noise.sigma_rel * depth)
    lost = rng.random(depth.shape) < noise.dropout
    with np.errstate(invalid="ignore"):
        lost |= depth <= 0
    return replace(view, depth=np.where(lost, np.nan, depth).astype(np.float32))
