"""The renderer for machines with an NVIDIA GPU: the package gsplat (Ye et al. 2024), an optional dependency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Renderer


@dataclass
class GsplatRendererConfig(ComponentConfig):
    """Options of the ``gsplat`` renderer; the defaults are those of 3D Gaussian splatting."""

    low_pass: float = 0.3
    """Added to both variances of a projected Gaussian, square pixels: none becomes thinner than a pixel."""
    near: float = 0.01
    """Gaussians with a centre nearer to the camera's plane than this are skipped, metres."""
    device: str = "cuda"
    """The CUDA device, such as ``cuda`` or ``cuda:1``."""


def _build(config: GsplatRendererConfig) -> Renderer:
    """Fastest, on an NVIDIA GPU; needs the package gsplat and a torch built for CUDA."""
    from gvla2_plugins.gsplat_renderer.renderer import GsplatRenderer

    return GsplatRenderer(config)


@hookimpl
def gvla2_renderers() -> list[Component[Renderer]]:
    """``renderer=gsplat``."""
    return [Component("gsplat", GsplatRendererConfig, _build)]
