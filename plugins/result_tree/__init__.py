"""Objects that MV-SAM3D, SAM3D or a released script has reconstructed before, read from their result tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Reconstructor


@dataclass
class ResultTreeConfig(ComponentConfig):
    """Options of the ``result_tree`` reconstructor: which ``<root>/<object>/<views>views/result.{ply,glb}``."""

    root: str = ""
    object: str = ""
    views: int = 5
    """The number in the folder's name, ``5views``."""
    axes: str = "auto"
    """From the result's frame to the calibrated one: ``auto``, ``identity`` or a word such as ``perm012_signpnn``."""
    refine: bool = True
    """Refine position, turn and scale on the masks."""
    gaussians: int = 15_000
    """About how many lie on the mesh of a result that has no Gaussians."""


def _build(config: ResultTreeConfig) -> Reconstructor:
    """Reads a finished result and aligns it with the views' masks."""
    from gvla2_plugins.result_tree.reconstructor import ResultTreeReconstructor

    return ResultTreeReconstructor(config)


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=result_tree``."""
    return [Component("result_tree", ResultTreeConfig, _build)]
