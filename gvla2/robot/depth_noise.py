"""Noise of depth cameras, put on clean observations."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation, View, Views
from gvla2.robot.camera_errors import darkened, flying, grazed, misplaced, tinted


@dataclass(frozen=True)
class DepthNoise:
    """What is wrong with a cell's cameras; each part by itself, all of them off by default.

    Of each pixel by itself: the deviation at a depth of d metres is ``sigma_m`` + ``sigma_rel`` * d metres; ``dropout``
    is the share of pixels in [0, 1] that measure nothing; ``flying`` the share of those at steps in depth that lie
    between both sides; ``grazing`` and ``dark`` the shares lost on surfaces seen along themselves and on dark ones;
    ``quantum_m`` the unit of depth, metres; ``colour`` the deviation of colours, in [0, 1].

    Of each camera, the same all episode long: ``bias_rel`` the deviation over cameras of an error in scale of depth,
    ``exposure`` that of their gain, and how far their pose is from where it is believed, ``offset_m`` metres and
    ``turn_deg`` degrees. ``kind`` is what this noise is called, a name for people.
    :mod:`gvla2.robot.camera_errors` has the sources. Raises :class:`ConfigurationError` for values out of range.
    """

    kind: str = "none"
    sigma_m: float = 0.0
    sigma_rel: float = 0.0
    dropout: float = 0.0
    flying: float = 0.0
    grazing: float = 0.0
    dark: float = 0.0
    bias_rel: float = 0.0
    quantum_m: float = 0.0
    colour: float = 0.0
    exposure: float = 0.0
    offset_m: float = 0.0
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        shares = {name: getattr(self, name) for name in ("dropout", "flying", "grazing", "dark")}
        sizes = {name: value for name, value in vars(self).items() if name not in (*shares, "kind")}
        wrong = [f"{n}={v}" for n, v in shares.items() if not 0 <= v <= 1]
        wrong += [f"{n}={v}" for n, v in sizes.items() if not 0 <= v < np.inf]
        if wrong:
            raise ConfigurationError(
                "Depth noise needs finite deviations >= 0 and shares in [0, 1] (dropout, flying, grazing, dark), got "
                f"{', '.join(wrong)}."
            )


def apply_noise(
    observation: Observation, noise: DepthNoise, rng: np.random.Generator, seed: int = 0
) -> Observation:
    """A copy of the observation with noise on every view; its other data are shared, not copied.

    NaN stays NaN, a depth pushed to zero or below becomes NaN, lost pixels become NaN. Robot masks stay: they
    come from the joints. ``rng`` draws what differs from look to look; what a camera has always wrong follows from
    ``seed`` and its name.
    """
    views = tuple(_disturb(view, noise, rng, seed) for view in observation.views)
    return replace(observation, views=Views(views))


def _disturb(view: View, noise: DepthNoise, rng: np.random.Generator, seed: int) -> View:
    rig = np.random.default_rng([seed, zlib.crc32(view.name.encode())])
    scale = 1.0 + noise.bias_rel * rig.standard_normal()
    if view.depth is not None:
        view = replace(view, depth=_measured(view, view.depth, noise, scale, rng))
    if noise.colour or noise.exposure:
        view = replace(view, image=tinted(view.image, noise.colour, noise.exposure, rig, rng))
    if noise.offset_m or noise.turn_deg:
        view = replace(view, camera=misplaced(view.camera, noise.offset_m, noise.turn_deg, rig))
    return view


def _measured(
    view: View, true: NDArray[np.float32], noise: DepthNoise, scale: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """(H, W) depth, metres."""
    depth: NDArray[np.float64] = true.astype(np.float64)
    lost = np.zeros(depth.shape, dtype=bool)
    if noise.grazing:
        lost |= grazed(view.camera, depth, noise.grazing, rng)
    if noise.dark:
        lost |= darkened(view.image, noise.dark, rng)
    if noise.flying:
        depth = flying(depth, noise.flying, rng)
    depth = scale * depth + rng.standard_normal(depth.shape) * (noise.sigma_m + noise.sigma_rel * depth)
    if noise.quantum_m:
        depth = noise.quantum_m * np.rint(depth / noise.quantum_m)
    lost |= rng.random(depth.shape) < noise.dropout
    with np.errstate(invalid="ignore"):
        lost |= depth <= 0
    return np.where(lost, np.nan, depth).astype(np.float32)
