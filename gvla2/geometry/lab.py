"""CIELAB of many pixels, compiled: scikit-image takes three times as long, and a look needs it for all its pixels.

A file of its own: what only compares a few colours need not load the compiler.
"""

from __future__ import annotations

import numpy as np

from gvla2.geometry.compiled import compiled
from gvla2.geometry.transform import FloatArray

_WHITE = np.array([0.95047, 1.0, 1.08883])
_XYZ = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)
TO_XYZ = _XYZ / _WHITE[:, None]
"""From linear RGB, white (D65) at 1, 1, 1."""


@compiled
def looks_of(rgb: FloatArray, lightness: float) -> FloatArray:
    """(N, 3) of sRGB colours (N, 3) in [0, 1]: 100 a*/(L* + 16), 100 b*/(L* + 16) and ``lightness`` times L*."""
    found, line, shares = np.empty(rgb.shape), np.empty(3), np.empty(3)
    for n in range(len(rgb)):
        for k in range(3):
            value = rgb[n, k]
            line[k] = ((value + 0.055) / 1.055) ** 2.4 if value > 0.04045 else value / 12.92
        for k in range(3):
            share = TO_XYZ[k, 0] * line[0] + TO_XYZ[k, 1] * line[1] + TO_XYZ[k, 2] * line[2]
            shares[k] = np.cbrt(share) if share > 0.008856 else 7.787 * share + 16.0 / 116.0
        level = 116.0 * shares[1]  # L* + 16
        found[n, 0] = 5e4 * (shares[0] - shares[1]) / level
        found[n, 1] = 2e4 * (shares[1] - shares[2]) / level
        found[n, 2] = lightness * (level - 16.0)
    return found
