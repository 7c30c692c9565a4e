"""The renderer for machines without a GPU: Gaussians in tiles, compiled by numba, on all cores."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Renderer


@dataclass
class NumbaRendererConfig(ComponentConfig):
    """Options of the ``numba`` renderer; the defaults are those of 3D Gaussian splatting."""

    low_pass: float = 0.3
    """Added to both variances of a projected Gaussian, square pixels: none becomes thinner than a pixel."""
    near: float = 0.01
    """Gaussians with a centre nearer to the camera's plane than this are skipped, metres."""


def _build(config: NumbaRendererConfig) -> Renderer:
    """Fast on the CPU: 100,000 Gaussians at 256 x 256 in tens of milliseconds."""
    from gvla2.reconstruction.rasteriser import Rasteriser

    return Rasteriser(config.low_pass, config.near)


@hookimpl
def gvla2_renderers() -> list[Component[Renderer]]:
    """``renderer=numba``."""
    return [Component("numba", NumbaRendererConfig, _build)]
