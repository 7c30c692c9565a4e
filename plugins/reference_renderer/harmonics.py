"""Colour from real spherical harmonics, as 3D Gaussian splatting stores them."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.harmonics import harmonics


def view_colours(gaussians: Gaussians, eye: FloatArray) -> FloatArray:
    """(N, 3) RGB >= 0 of each Gaussian seen from ``eye`` (3,), in the Gaussians' frame, metres."""
    colour = gaussians.rgb.astype(np.float64)
    if gaussians.sh_rest is not None:
        away = gaussians.centres - eye
        directions = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
        count = gaussians.sh_rest.shape[1] // 3
        coefficients = gaussians.sh_rest.reshape(len(gaussians), 3, count)  # files hold channel by channel
        colour = colour + np.einsum(
            "nck,nk->nc", coefficients, np.stack(harmonics(*directions.T), axis=1)[:, :count]
        )
    return np.maximum(colour, 0.0)
