"""The published fusion strategies: axis_only, blend, residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import FusionStrategy


@dataclass
class ShareConfig(ComponentConfig):
    """Options of ``blend`` and ``residual``: ``alpha`` in [0, 1] is the share of source B, at full support."""

    alpha: float = 0.5


def _axis_only(config: ComponentConfig) -> FusionStrategy:
    """Takes source B's geometry, axis compensation alone."""
    from gvla2_plugins.fusions.strategies import Blend

    return Blend(1.0)


def _blend(config: ShareConfig) -> FusionStrategy:
    """Blends the sources evenly: (1 - alpha) A + alpha B."""
    from gvla2_plugins.fusions.strategies import Blend

    return Blend(config.alpha)


def _residual(config: ShareConfig) -> FusionStrategy:
    """Moves A towards B as far as the masks support both."""
    from gvla2_plugins.fusions.strategies import Residual

    return Residual(config.alpha)


@hookimpl
def gvla2_fusion_strategies() -> list[Component[FusionStrategy]]:
    """Offer the three strategies."""
    return [
        Component("axis_only", ComponentConfig, _axis_only),
        Component("blend", ShareConfig, _blend),
        Component("residual", ShareConfig, _residual),
    ]
