"""Fusing the centres of two sources; each implements :class:`gvla2.reconstruction.contracts.FusionStrategy`."""

from __future__ import annotations

import numpy as np

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.transform import FloatArray


class AxisOnly:
    """x_out = x_B."""

    def fuse(self, a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """Source B's centres (N, 3)."""
        _check(a, b, support_a, support_b)
        return np.array(b, dtype=np.float64)


class Blend:
    """p_out = (1 - alpha) p_A + alpha p_B (paper, conservative geometry blend)."""

    def __init__(self, alpha: float) -> None:
        self.alpha = _share(alpha, "blend")

    def fuse(self, a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """Centres (N, 3) between A's and B's, the same share for all."""
        _check(a, b, support_a, support_b)
        return np.asarray(a + self.alpha * (b - a))


class Residual:
    """x_out = x_A + alpha w (x_B - x_A), w = clip(s(x_A) s(x_B), 0, 1) (paper, confidence-weighted residual fusion)."""

    def __init__(self, alpha: float) -> None:
        self.alpha = _share(alpha, "residual")

    def fuse(self, a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """Centres (N, 3) between A's and B's; a point that the masks do not support stays at A."""
        _check(a, b, support_a, support_b)
        weight = np.clip(support_a * support_b, 0.0, 1.0)
        return np.asarray(a + self.alpha * weight[:, None] * (b - a))


def _share(alpha: float, name: str) -> float:
    if not 0 <= alpha <= 1:
        raise ConfigurationError(f"fusion={name}: alpha must lie in [0, 1], got {alpha}.")
    return alpha


def _check(a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> None:
    n = (len(a),)
    if a.shape != b.shape or a.shape[1:] != (3,) or support_a.shape != n or support_b.shape != n:
        raise GeometryError(
            "Fusion takes centres (N, 3) and supports (N,) of both sources alike, got "
            f"{a.shape}, {b.shape}, {support_a.shape}, {support_b.shape}."
        )
