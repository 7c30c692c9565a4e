"""Noise of depth cameras, added to clean observations as :class:`DepthNoise` specifies."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.views import Observation, View, Views
from gvla2.robot.camera_errors import darkened, flying, grazed, misplaced, tinted
from gvla2.robot.noise_options import DepthNoise


def apply_noise(
    observation: Observation, noise: DepthNoise, rng: np.random.Generator, seed: int = 0
) -> Observation:
    """A copy of the observation with noise on every view; its other data are shared, not copied.

    NaN stays NaN, a depth pushed to zero or below becomes NaN, lost pixels become NaN. Robot masks stay: they come from
    the joints. ``rng`` draws the noise of each look; a camera's constant errors follow from ``seed`` and its name.
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
