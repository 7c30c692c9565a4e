"""A renderer to compare others with: Gaussians composited exactly, one by one, in numpy."""

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
    """Gaussians with a centre nearer to the camera's plane than this are skipped, metres."""
    min_alpha: float = 1 / 255
    """Contributions below this opacity are skipped."""
    max_alpha: float = 0.99
    """The most that a single Gaussian hides."""


def _build(config: ReferenceRendererConfig) -> Renderer:
    """Exact and slow, for small images and for comparison."""
    from gvla2_plugins.reference_renderer.renderer import ReferenceRenderer

    return ReferenceRenderer(config)


@hookimpl
def gvla2_renderers() -> list[Component[Renderer]]:
    """``renderer=reference``."""
    return [Component("reference", ReferenceRendererConfig, _build)]
