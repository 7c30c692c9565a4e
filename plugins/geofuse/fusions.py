"""Fusing the centres of two sources; each implements :class:`gvla2.reconstruction.contracts.FusionStrategy`."""

from __future__ import annotations

import numpy as np

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.transform import FloatArray


class Blend:
    """p_out = (1 - alpha) p_A + alpha p_B (paper, conservative geometry blend)."""

    def __init__(self, alpha: float) -> None:
        if not 0 <= alpha <= 1:
            raise ConfigurationError(f"fusion.alpha must lie in [0, 1], got {alpha}.")
        self.alpha = alpha

    def fuse(self, a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """Centres (N, 3) between A's and B's."""
        n = (len(a),)
        if a.shape != b.shape or a.shape[1:] != (3,) or support_a.shape != n or support_b.shape != n:
            raise GeometryError(
                "Fusion takes centres (N, 3) and supports (N,) of both sources alike, got "
                f"{a.shape}, {b.shape}, {support_a.shape}, {support_b.shape}."
            )
        return np.asarray(a + self.alpha * self.weight(support_a, support_b)[:, None] * (b - a))

    def weight(self, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """(N,) share of the way: the same for all."""
        return np.ones(len(support_a))


class Residual(Blend):
    """x_out = x_A + alpha w (x_B - x_A), w = clip(s(x_A) s(x_B), 0, 1) (paper, confidence-weighted residual fusion)."""

    def weight(self, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """(N,) the masks' support of both: a point that they do not support stays at A."""
        return np.clip(support_a * support_b, 0.0, 1.0)
