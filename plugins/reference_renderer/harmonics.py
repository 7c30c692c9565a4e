"""Colour from real spherical harmonics, as 3D Gaussian splatting stores them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.transform import FloatArray


def view_colours(gaussians: Gaussians, eye: FloatArray) -> FloatArray:
    """(N, 3) RGB >= 0 of each Gaussian seen from ``eye`` (3,), in the Gaussians' frame, metres."""
    colour = gaussians.rgb.astype(np.float64)
    if gaussians.sh_rest is not None:
        away = gaussians.centres - eye
        directions = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
        count = gaussians.sh_rest.shape[1] // 3
        coefficients = gaussians.sh_rest.reshape(len(gaussians), 3, count)  # files hold channel by channel
        colour = colour + np.einsum("nck,nk->nc", coefficients, _basis(directions)[:, :count])
    return np.maximum(colour, 0.0)


def _basis(directions: FloatArray) -> NDArray[np.float64]:
    """(N, 15) real harmonics of degrees 1 to 3 at unit directions (N, 3), in the order and signs of 3DGS."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    return np.stack(
        [
            -0.4886025119 * y,
            0.4886025119 * z,
            -0.4886025119 * x,
            1.0925484306 * x * y,
            -1.0925484306 * y * z,
            0.3153915653 * (2 * zz - xx - yy),
            -1.0925484306 * x * z,
            0.5462742153 * (xx - yy),
            -0.5900435899 * y * (3 * xx - yy),
            2.8906114426 * x * y * z,
            -0.4570457995 * y * (4 * zz - xx - yy),
            0.3731763326 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457995 * x * (4 * zz - xx - yy),
            1.4453057213 * z * (xx - yy),
            -0.5900435899 * x * (xx - 3 * yy),
        ],
        axis=1,
    )
