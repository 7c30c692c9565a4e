"""The visual hull: space carving from the masks, coloured by the views that see each point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Reconstructor


@dataclass
class HullConfig(ComponentConfig):
    """Options of the ``hull`` reconstructor."""

    resolution: int = 96
    """Voxels along a side of a cube as large as the object's box."""
    gaussians: int = 15_000
    """Approximate number of Gaussians on the surface."""


def _build(config: HullConfig) -> Reconstructor:
    """Carves the object from its masks: closed, conservative, under a second."""
    from gvla2_plugins.hull.reconstructor import HullReconstructor

    return HullReconstructor(config)


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=hull``."""
    return [Component("hull", HullConfig, _build)]
