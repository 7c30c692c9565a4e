"""A short 3D Gaussian splatting optimisation that starts from a reconstruction and stays near it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import Reconstruction, StageReport
from gvla2.reconstruction.rasteriser import Frame, RasterOptions, backward, forward

Floats = NDArray[np.float32]
WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class SplatOptions:
    iterations: int = 400
    rate_centres: float = 0.02  # of the spacing
    rate_scales: float = 0.01
    rate_rotations: float = 0.005
    rate_opacity: float = 0.02
    rate_colour: float = 0.02
    final_rate: float = 0.05
    weight_alpha: float = 0.5
    weight_anchor: float = 0.02
    weight_scale: float = 0.02
    weight_opacity: float = 0.0
    weight_colour: float = 0.0
    l2: float = 0.0
    seed: int = 0
    threads: int = 0
