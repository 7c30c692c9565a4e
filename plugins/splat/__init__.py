"""The strong baseline: the visual hull, then a short 3D Gaussian splatting optimisation on the CPU."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Reconstructor


@dataclass
class SplatConfig(ComponentConfig):
    """Options of the ``splat`` reconstructor."""

    resolution: int = 96
    """Voxels along a side of a cube as large as the object's box, for the hull."""
    gaussians: int = 15_000
    """Approximate number of Gaussians on the hull's surface."""
    shape_iterations: int = 200
    """Steps of the first optimisation, one view each: without a low-pass, for the shape. The mesh follows it."""
    iterations: int = 100
    """Steps of the second optimisation: with the renderers' low-pass, for the pictures."""
    smooth_centres: float = 0.1
    """How strongly neighbouring Gaussians move together; less fits the inputs better and other views worse."""
    smooth_colours: float = 0.3
    """The same for their colours."""
    carry_mesh: bool = True
    """Whether the hull's mesh follows the Gaussians' shape; without it the mesh stays exactly the hull's."""
    seed: int = 0
    """Orders the views."""
    threads: int = 0
    """Rendering threads, 0 for one per core; the result does not depend on them."""


def _build(config: SplatConfig) -> Reconstructor:
    """Hull, then a short splatting optimisation; several seconds, closer to the true surface."""
    from gvla2_plugins.splat.reconstructor import SplatReconstructor

    return SplatReconstructor(config)


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=splat``."""
    return [Component("splat", SplatConfig, _build)]
