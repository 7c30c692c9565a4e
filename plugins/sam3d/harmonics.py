"""Rotating spherical harmonics: a Gaussian's view-dependent colour when its frame turns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.harmonics import harmonics


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


def _basis(directions: FloatArray) -> FloatArray:
    """(M, 15) at unit directions (M, 3)."""
    return np.stack(harmonics(*directions.T), axis=1)
