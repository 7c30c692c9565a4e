"""MV-SAM3D: finished results of it and related programs, or runs from the user's own checkout.

gvla2 ships neither its code nor its weights: both have their own licences.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Reconstructor


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


def _external(config: ExternalConfig) -> Reconstructor:
    """Runs your checkout of MV-SAM3D on all views."""
    from gvla2_plugins.sam3d.external import ExternalReconstructor

    return ExternalReconstructor(config)


def _finished(config: ResultTreeConfig) -> Reconstructor:
    """Reads a finished result and aligns it with the views' masks."""
    from gvla2_plugins.sam3d.results import ResultTreeReconstructor

    return ResultTreeReconstructor(config)


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=result_tree``, ``reconstructor=mv_sam3d``."""
    return [
        Component("result_tree", ResultTreeConfig, _finished),
        Component("mv_sam3d", ExternalConfig, _external),
    ]
