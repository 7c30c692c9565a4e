"""Turning spherical harmonics: what a Gaussian's view-dependent colour becomes when its frame turns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray


def turned_harmonics(sh_rest: NDArray[np.float32], rotation: FloatArray) -> NDArray[np.float32]:
    """Coefficients (N, 3k) of the files, k = 3, 8 or 15, in a frame turned by ``rotation`` (3, 3).

    The colour seen along a direction d before is the colour seen along R d after. Each degree turns within itself;
    its matrix is found from the basis' values at as many directions as fix it.
    """
    n, columns = sh_rest.shape
    coefficients = sh_rest.reshape(n, 3, columns // 3).astype(np.float64)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = _basis(directions), _basis(directions @ rotation.T)
    turned = np.empty_like(coefficients)
    start = 0
    for degree in range(1, 4):
        stop = start + 2 * degree + 1
        if stop > coefficients.shape[2]:
            break
        matrix = np.linalg.lstsq(after[:, start:stop], before[:, start:stop], rcond=None)[0]
        turned[:, :, start:stop] = coefficients[:, :, start:stop] @ matrix.T
        start = stop
    return turned.reshape(n, columns).astype(np.float32)


def _basis(d: FloatArray) -> FloatArray:
    """(M, 15) real harmonics of degree 1 to 3 at unit directions (M, 3), in the order and signs of 3DGS."""
    x, y, z = d.T
    xx, yy, zz = x * x, y * y, z * z
    return np.stack(
        [
            -0.4886025 * y,
            0.4886025 * z,
            -0.4886025 * x,
            1.0925484 * x * y,
            -1.0925484 * y * z,
            0.3153916 * (2 * zz - xx - yy),
            -1.0925484 * x * z,
            0.5462742 * (xx - yy),
            -0.5900436 * y * (3 * xx - yy),
            2.8906114 * x * y * z,
            -0.4570458 * y * (4 * zz - xx - yy),
            0.3731763 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570458 * x * (4 * zz - xx - yy),
            1.4453057 * z * (xx - yy),
            -0.5900436 * x * (xx - 3 * yy),
        ],
        axis=1,
    )
