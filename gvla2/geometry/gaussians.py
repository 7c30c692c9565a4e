"""3D Gaussians as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians (placeholder of the contract; the geometry floor fills it)."""

    centres: NDArray[np.float32]
