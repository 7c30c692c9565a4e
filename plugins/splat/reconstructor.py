"""From masked views to the hull, and from there to Gaussians that explain the pictures."""

from __future__ import annotations

from dataclasses import replace

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.inset import fill_masks
from gvla2_plugins.splat import SplatConfig
from gvla2_plugins.splat.splatting import SplatOptions, carry, optimise

_SHARP = (
    0.02  # low-pass for the shape, square pixels: surfels overlap, so that little is needed to close holes
)


class SplatReconstructor:
    """Space carving for the start, splatting for the rest: first for the shape, then for the pictures.

    The status is the carving's, followed by that of an optimisation whose result was not kept.
    """

    def __init__(self, config: SplatConfig) -> None:
        for option, least in (
            ("resolution", 8),
            ("gaussians", 1),
            ("shape_iterations", 0),
            ("iterations", 0),
        ):
            if getattr(config, option) < least:
                raise ConfigurationError(
                    f"reconstructor.{option} is {getattr(config, option)}; {least} is the least."
                )
        self._config = config
        self._options = SplatOptions(
            iterations=config.iterations,
            smooth_centres=config.smooth_centres,
            smooth_colours=config.smooth_colours,
            seed=config.seed,
            threads=config.threads,
        )

    def reconstruct(self, views: Views) -> Reconstruction:
        """The object that the views' masks show; :class:`GeometryError` when they show none."""
        hull = carve(views, self._config.resolution).to_reconstruction(self._config.gaussians)
        if hull.gaussians is None:
            return hull
        sharp = replace(self._options, low_pass=_SHARP, iterations=self._config.shape_iterations)
        shaped, first = optimise(hull.gaussians, views, sharp)
        mesh = hull.mesh
        if mesh is not None and self._config.carry_mesh:
            # The Gaussians moved inside their surface, and the mesh with them: move it back to the surface.
            mesh = fill_masks(carry(mesh, hull.gaussians, shaped), views)
        fitted, second = optimise(shaped, views, self._options)
        notes = [] if hull.status == "ok" else [hull.status]
        notes += [f"{r.status}: {r.reason}" for r in (first, second) if r.status == "rejected"]
        return Reconstruction(fitted, mesh, "; ".join(notes) or "ok")
