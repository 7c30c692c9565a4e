"""From masked views to the hull, and from there to Gaussians that explain the pictures."""

from __future__ import annotations

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.splatting import SplatOptions, carry, optimise
from gvla2_plugins.splat import SplatConfig


class SplatReconstructor:
    """Space carving for the start, splatting for the rest.

    The status is the carving's, followed by the optimisation's where it changed nothing.
    """

    def __init__(self, config: SplatConfig) -> None:
        if config.gaussians < 1:
            raise ConfigurationError(
                f"reconstructor=splat needs at least one Gaussian, got {config.gaussians}."
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
        fitted, report = optimise(hull.gaussians, views, self._options)
        mesh = hull.mesh
        if mesh is not None and self._config.carry_mesh and report.status == "applied":
            mesh = carry(mesh, hull.gaussians, fitted)
        told = [] if hull.status == "ok" else [hull.status]
        if report.status != "applied":
            told.append(f"{report.status}: {report.reason}")
        return Reconstruction(fitted, mesh, "; ".join(told) or "ok")
