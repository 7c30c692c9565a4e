"""The published fusion strategies: axis_only, blend, residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import FusionStrategy


@dataclass
class AxisOnlyConfig(ComponentConfig):
    """``axis_only`` has no options."""


@dataclass
class BlendConfig(ComponentConfig):
    """Options of ``blend``: ``alpha`` in [0, 1] is the share of source B."""

    alpha: float = 0.5


@dataclass
class ResidualConfig(ComponentConfig):
    """Options of ``residual``: ``alpha`` in [0, 1] is the fraction of the way to source B at full support."""

    alpha: float = 0.5


def _axis_only(config: AxisOnlyConfig) -> FusionStrategy:
    """Takes source B's geometry, axis compensation alone."""
    from gvla2_plugins.fusions.strategies import AxisOnly

    return AxisOnly()


def _blend(config: BlendConfig) -> FusionStrategy:
    """Blends the sources evenly: (1 - alpha) A + alpha B."""
    from gvla2_plugins.fusions.strategies import Blend

    return Blend(config.alpha)


def _residual(config: ResidualConfig) -> FusionStrategy:
    """Moves A towards B as far as the masks support both."""
    from gvla2_plugins.fusions.strategies import Residual

    return Residual(config.alpha)


@hookimpl
def gvla2_fusion_strategies() -> list[Component[FusionStrategy]]:
    """Offer the three strategies."""
    return [
        Component("axis_only", AxisOnlyConfig, _axis_only),
        Component("blend", BlendConfig, _blend),
        Component("residual", ResidualConfig, _residual),
    ]
