"""Sources, fusion strategies and the renderer of the GeoFuse-MV3D branch.

MV-SAM3D itself, code and weights, does not come with gvla2: both have their own licences.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import FusionStrategy, GeometryPrior, Reconstructor, Renderer


@dataclass
class HullConfig(ComponentConfig):
    """Options of the ``hull`` reconstructor."""

    resolution: int = 96
    """Voxels along a side of a cube as large as the object's box."""
    gaussians: int = 15_000
    """Approximate number of Gaussians on the surface."""


@dataclass
class ResultTreeConfig(ComponentConfig):
    """Options of the ``result_tree`` reconstructor, which reads ``<root>/<object>/<views>views/result.{glb,ply}``.

    ``gaussians``: approximate number of Gaussians on the mesh of a result without any.
    """

    root: str = ""
    object: str = ""
    views: int = 5
    gaussians: int = 15_000


@dataclass
class ExternalConfig(ComponentConfig):
    """Options of ``mv_sam3d``.

    ``checkout``: folder of the program's own repository. ``python``: interpreter of the environment that it was
    installed into. ``timeout_s``: seconds after which the program is ended. ``gaussians`` as in ``result_tree``.
    """

    checkout: str = ""
    python: str = "python"
    timeout_s: float = 3600.0
    gaussians: int = 15_000


@dataclass
class FilePriorConfig(ComponentConfig):
    """Options of the ``file`` prior: ``path`` is the .npz file, required; one file serves one set of views.

    Its arrays, for S views in the order of the run's: ``depth`` (S, h, w) along each camera's z, NaN or <= 0 where
    unknown; optional ``confidence`` (S, h, w), >= 0, default 1; optional poses ``world_from_camera`` (S, 4, 4), OpenCV
    axes, in the prior's own frame and scale. Without poses the depth is metric and belongs to the calibrated cameras.
    """

    path: str = ""


@dataclass
class ShareConfig(ComponentConfig):
    """Options of ``blend`` and ``residual``: ``alpha`` in [0, 1] is the share of source B, at full support."""

    alpha: float = 0.5


@dataclass
class NumbaRendererConfig(ComponentConfig):
    """Options of the ``numba`` renderer; the defaults are those of 3D Gaussian splatting."""

    low_pass: float = 0.3
    """Added to both variances of a projected Gaussian, square pixels: none becomes thinner than a pixel."""
    near: float = 0.01
    """Gaussians with a centre nearer to the camera's plane than this are skipped, metres."""


def _hull(config: HullConfig) -> Reconstructor:
    """Carves the object from its masks: closed, conservative, under a second."""
    from gvla2_plugins.geofuse.sources import HullReconstructor

    return HullReconstructor(config)


def _result_tree(config: ResultTreeConfig) -> Reconstructor:
    """Reads a finished result and aligns it with the views' masks."""
    from gvla2_plugins.geofuse.results import ResultTreeReconstructor

    return ResultTreeReconstructor(config)


def _external(config: ExternalConfig) -> Reconstructor:
    """Runs your checkout of MV-SAM3D on all views."""
    from gvla2_plugins.geofuse.external import ExternalReconstructor

    return ExternalReconstructor(config)


def _file(config: FilePriorConfig) -> GeometryPrior:
    """Reads depth from an external .npz file."""
    from gvla2_plugins.geofuse.sources import FilePrior

    return FilePrior(config)


def _axis_only(config: ComponentConfig) -> FusionStrategy:
    """Takes source B's geometry, axis compensation alone."""
    from gvla2_plugins.geofuse.fusions import Blend

    return Blend(1.0)


def _blend(config: ShareConfig) -> FusionStrategy:
    """Blends the sources evenly: (1 - alpha) A + alpha B."""
    from gvla2_plugins.geofuse.fusions import Blend

    return Blend(config.alpha)


def _residual(config: ShareConfig) -> FusionStrategy:
    """Moves A towards B as far as the masks support both."""
    from gvla2_plugins.geofuse.fusions import Residual

    return Residual(config.alpha)


def _numba(config: NumbaRendererConfig) -> Renderer:
    """Fast on the CPU: 100,000 Gaussians at 256 x 256 in tens of milliseconds."""
    from gvla2.reconstruction.rasteriser import Rasteriser

    return Rasteriser(config.low_pass, config.near)


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """Return the sources of a first reconstruction: carved here, read from a file, or made by MV-SAM3D."""
    return [
        Component("hull", HullConfig, _hull),
        Component("result_tree", ResultTreeConfig, _result_tree),
        Component("mv_sam3d", ExternalConfig, _external),
    ]


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=file prior.path=depth.npz``."""
    return [Component("file", FilePriorConfig, _file)]


@hookimpl
def gvla2_fusion_strategies() -> list[Component[FusionStrategy]]:
    """Return the three published strategies."""
    return [
        Component("axis_only", ComponentConfig, _axis_only),
        Component("blend", ShareConfig, _blend),
        Component("residual", ShareConfig, _residual),
    ]


@hookimpl
def gvla2_renderers() -> list[Component[Renderer]]:
    """``renderer=numba``: Gaussians in tiles, compiled by numba, on all cores."""
    return [Component("numba", NumbaRendererConfig, _numba)]
