"""A geometry prior that was computed elsewhere and saved as an .npz file.

The file holds, for S views in the order of the run's views:

    depth               (S, h, w)     along each camera's z, NaN or <= 0 where unknown
    confidence          (S, h, w)     optional, >= 0, default 1
    world_from_camera   (S, 4, 4)     optional poses (OpenCV axes) in the prior's own frame and scale; without them
                                      the depth is metric and belongs to the calibrated cameras

The pictures may differ in size from the views, with the same aspect ratio within two percent: they are resized by the
nearest pixel, which never invents depth between two surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import GeometryPrior


@dataclass
class FilePriorConfig(ComponentConfig):
    """Options of the ``file`` prior: ``path`` is the .npz file, required; one file serves one set of views.

    Its arrays, for S views: ``depth`` (S, h, w) along each camera's z; optional ``confidence`` (S, h, w) and
    ``world_from_camera`` (S, 4, 4).
    """

    path: str = ""


def _build(config: FilePriorConfig) -> GeometryPrior:
    """Reads depth from an external .npz file."""
    from gvla2_plugins.file_prior.prior import FilePrior

    return FilePrior(config)


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=file prior.path=depth.npz``."""
    return [Component("file", FilePriorConfig, _build)]
