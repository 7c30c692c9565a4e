"""The strong baseline: the visual hull, then a short 3D Gaussian splatting optimisation on the CPU."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Reconstructor


@dataclass
class SplatConfig(ComponentConfig):
    """Options of the ``splat`` reconstructor.

    ``resolution``: voxels along a side of a cube as large as the object's box, for the hull. ``gaussians``: approximate
    number on the hull's surface. ``shape_iterations``: steps of the first optimisation, one view each, without a
    low-pass, for the shape; the mesh follows it. ``iterations``: steps of the second one, with the renderers' low-pass,
    for the pictures. ``smooth_centres``, ``smooth_colours``: how strongly neighbouring Gaussians move and change colour
    together; less fits the inputs better and other views worse. ``seed`` orders the views.
    """

    resolution: int = 96
    gaussians: int = 15_000
    shape_iterations: int = 200
    iterations: int = 100
    smooth_centres: float = 0.1
    smooth_colours: float = 0.3
    seed: int = 0


def _build(config: SplatConfig) -> Reconstructor:
    """Hull, then a short splatting optimisation; several seconds, closer to the true surface."""
    from gvla2_plugins.splat.reconstructor import SplatReconstructor

    return SplatReconstructor(config)


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=splat``."""
    return [Component("splat", SplatConfig, _build)]
