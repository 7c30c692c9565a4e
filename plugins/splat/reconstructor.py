"""From masked views to the hull, and from there to Gaussians that explain the pictures."""

from __future__ import annotations

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.inset import fill_masks
from gvla2_plugins.splat import SplatConfig
from gvla2_plugins.splat.splatting import carry, optimise

_SHARP = 0.02  # low-pass for the shape, square pixels: surfels overlap, so little is needed to close holes
_LEAST = {"resolution": 8, "gaussians": 1, "shape_iterations": 0, "iterations": 0}


class SplatReconstructor:
    """Space carving for the start, splatting for the rest: first for the shape, then for the pictures.

    The status is the carving's, followed by that of an optimisation whose result was not kept.
    """

    def __init__(self, config: SplatConfig) -> None:
        for option, least in _LEAST.items():
            if getattr(config, option) < least:
                raise ConfigurationError(
                    f"reconstructor.{option} is {getattr(config, option)}; {least} is the least."
                )
        self._config = config

    def reconstruct(self, views: Views) -> Reconstruction:
        """The object that the views' masks show; :class:`GeometryError` when they show none."""
        c = self._config
        hull = carve(views, c.resolution).to_reconstruction(c.gaussians)
        if hull.gaussians is None or hull.mesh is None:
            return hull
        shaped, first = optimise(hull.gaussians, views, c, c.shape_iterations, _SHARP)
        # The Gaussians moved inside their surface, and the mesh with them: move it back to the surface.
        mesh = fill_masks(carry(hull.mesh, hull.gaussians, shaped), views)
        fitted, second = optimise(shaped, views, c, c.iterations)
        notes = [] if hull.status == "ok" else [hull.status]
        notes += [f"{r.status}: {r.reason}" for r in (first, second) if r.status == "rejected"]
        return Reconstruction(fitted, mesh, "; ".join(notes) or "ok")
