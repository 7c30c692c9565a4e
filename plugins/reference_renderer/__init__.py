"""A renderer to compare others with: Gaussians composited exactly, one after the other, in numpy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Renderer


@dataclass
class ReferenceRendererConfig(ComponentConfig):
    """Options of the ``reference`` renderer; the defaults are those of 3D Gaussian splatting."""

    low_pass: float = 0.3
    """Added to both variances of a projected Gaussian, square pixels: none becomes thinner than a pixel."""
    near: float = 0.01
    """Gaussians whose centre is nearer to the camera's plane than this are left out, metres."""
    min_alpha: float = 1 / 255
    """Contributions below this opacity are left out."""
    max_alpha: float = 0.99
    """No Gaussian alone hides more than this."""


def _build(config: ReferenceRendererConfig) -> Renderer:
    """Exact and slow, for small images and for comparison."""
    from gvla2_plugins.reference_renderer.renderer import ReferenceRenderer

    return ReferenceRenderer(config)


@hookimpl
def gvla2_renderers() -> list[Component[Renderer]]:
    """``renderer=reference``."""
    return [Component("reference", ReferenceRendererConfig, _build)]
