"""Triangle meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Mesh:
    """Placeholder of the contract; the geometry floor fills it."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
