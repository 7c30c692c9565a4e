"""Appearance calibration: a gain and a bias a channel that bring a render near to its photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled

LEAST_PIXELS = 16
"""With fewer masked pixels, nothing is fitted."""
_ROUNDS = 60
_SHARPEST = 1e-5  # residuals below count as zero; a step of an 8-bit image is 4e-3


@dataclass(frozen=True)
class Affine:
    """image -> gain * image + bias, a channel; ``gain`` (3,), ``bias`` (3,), for images in [0, 1].

    ``reason`` is empty, or says why a channel (or all) stayed as it was.
    """

    gain: FloatArray
    bias: FloatArray
    reason: str = ""


def fit_affine(rendered: ArrayLike, observed: ArrayLike, mask: ArrayLike, beta: float = 0.01) -> Affine:
    """The (g, b) a channel that minimise the paper's masked L1 with a ridge toward identity.

        sum_u M(u) |g I^(u) + b - I(u)| / sum_u M(u)  +  beta (g - 1)^2 + beta b^2     over M(u) > 0

    ``rendered``, ``observed`` (H, W, 3) uint8 or in [0, 1]; ``mask`` (H, W) in [0, 1], whose values weigh the
    pixels. The data term is a mean, so that ``beta`` means the same at any resolution (the paper's beta is ours
    times sum M). Solved by iteratively reweighted least squares, 2 x 2 a channel and round. Pixels that are
    not finite are left out. Identity, with a reason, for fewer than 16 masked pixels; a channel whose render is
    constant gets no gain when beta = 0, and one whose best gain is not positive stays as it was.
    Raises :class:`GeometryError` for sizes that differ or beta < 0.
    """
    x, y = _unit(rendered, "rendered"), _unit(observed, "observed")
    weights = np.asarray(mask, dtype=np.float64)
    if x.ndim != 3 or x.shape != y.shape or x.shape[:2] != weights.shape:
        raise GeometryError(
            f"Appearance: rendered {x.shape} and observed {y.shape} must be (H, W, 3) alike, "
            f"and the mask {weights.shape} (H, W)."
        )
    if not beta >= 0:
        raise GeometryError(f"Appearance: beta must be >= 0, got {beta}.")
    used = (weights > 0) & np.isfinite(weights) & np.isfinite(x).all(axis=2) & np.isfinite(y).all(axis=2)
    if used.sum() < LEAST_PIXELS:
        reason = f"only {int(used.sum())} masked pixels, {LEAST_PIXELS} are needed"
        return Affine(np.ones(3), np.zeros(3), reason)
    share = weights[used] / weights[used].sum()
    gain, bias, reasons = np.ones(3), np.zeros(3), []
    for channel, name in enumerate(("red", "green", "blue")):
        source = np.ascontiguousarray(x[used][:, channel])
        target = np.ascontiguousarray(y[used][:, channel])
        gain[channel], bias[channel] = _solve(source, target, share, beta)
        if np.ptp(source) < 1e-6 and beta == 0:
            reasons.append(f"{name}: the render is constant, only the bias was fitted")
        if gain[channel] <= 0:
            gain[channel], bias[channel] = 1.0, 0.0
            reasons.append(f"{name}: render and image are not alike (best gain <= 0)")
    return Affine(gain, bias, "; ".join(reasons))


def _unit(image: ArrayLike, what: str) -> FloatArray:
    """The image as float64 in [0, 1], its last axis 3."""
    array = np.asarray(image)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise GeometryError(f"Appearance: {what} must have 3 channels, got shape {array.shape}.")
    scale = 1 / 255 if array.dtype == np.uint8 else 1.0
    return np.asarray(array * scale, dtype=np.float64)


@compiled
def _solve(x: FloatArray, y: FloatArray, share: FloatArray, beta: float) -> tuple[float, float]:
    """The minimum of sum share |g x + b - y| + beta (g - 1)^2 + beta b^2 over (g, b); ``share`` sums to 1."""
    gain, bias = 1.0, 0.0
    sharp = 0.1
    for _ in range(_ROUNDS):
        sxx = sx = s = sxy = sy = 0.0
        for k in range(len(x)):
            w = 0.5 * share[k] / max(abs(gain * x[k] + bias - y[k]), sharp)
            sxx += w * x[k] * x[k]
            sx += w * x[k]
            s += w
            sxy += w * x[k] * y[k]
            sy += w * y[k]
        a, d = sxx + beta, s + beta
        determinant = a * d - sx * sx
        if determinant > 1e-10 * a * d:
            new_gain = (d * (sxy + beta) - sx * sy) / determinant
            new_bias = (a * sy - sx * (sxy + beta)) / determinant
        else:  # a constant render: gain and bias cannot be told apart
            new_gain = 1.0
            new_bias = (sy - sx) / d
        change = max(abs(new_gain - gain), abs(new_bias - bias))
        gain, bias = new_gain, new_bias
        if change < 1e-7 and sharp <= _SHARPEST:
            break
        # Sharpening step by step keeps early rounds from freezing at pixels that happen to fit.
        sharp = max(0.6 * sharp, _SHARPEST)
    return gain, bias
