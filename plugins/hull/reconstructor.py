"""Carving as a reconstructor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.inset import inset
from gvla2.reconstruction.rasteriser import Rasteriser

if TYPE_CHECKING:
    from gvla2_plugins.hull import HullConfig


class HullReconstructor:
    """Space carving with colours, see :func:`gvla2.reconstruction.carving.carve`.

    Raises :class:`ConfigurationError` for fewer than 8 voxels per side or no Gaussians.
    """

    def __init__(self, config: HullConfig) -> None:
        if config.resolution < 8:
            raise ConfigurationError(f"reconstructor.resolution is {config.resolution}; 8 is the minimum.")
        if config.gaussians < 1:
            raise ConfigurationError(f"reconstructor.gaussians is {config.gaussians}; 1 is the minimum.")
        self._config = config

    def reconstruct(self, views: Views) -> Reconstruction:
        """Mesh and Gaussians of the object in the masks; a :class:`gvla2.errors.GeometryError` when none shows it."""
        carved = carve(views, self._config.resolution).to_reconstruction(self._config.gaussians)
        masked = Views(tuple(view for view in views if view.mask is not None))
        # Their footprints end at the masks' edges, not their centres.
        return inset(carved, masked, Rasteriser())[0]
