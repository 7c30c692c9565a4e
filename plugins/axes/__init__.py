"""Axis compensations, source B of the branch: by silhouette contours, or by the paper's mask energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import AxisCompensation


@dataclass
class ContoursConfig(ComponentConfig):
    """Options of ``contours``.

    ``iterations``: maximum number of Gauss-Newton steps. ``contour_points``: points used per mask contour.
    ``least_gain``: gain in symmetric IoU below which the shape is left unchanged. ``scale_bound``: most that an axis
    grows or shrinks, as a share of itself; ``shift_bound``: most shift along an axis, as a share of the longest side.
    """

    iterations: int = 10
    contour_points: int = 400
    least_gain: float = 5e-4
    scale_bound: float = 0.1
    shift_bound: float = 0.05


@dataclass
class MaskEnergyConfig(ComponentConfig):
    """Options of ``mask_energy``: ``iterations``; L-BFGS-B takes up to five times as many."""

    iterations: int = 10


def _contours(config: ContoursConfig) -> AxisCompensation:
    """Makes the outlines meet the masks' contours; kept when the symmetric IoU rises."""
    from gvla2_plugins.axes.compensations import Contours

    return Contours(config)


def _mask_energy(config: MaskEnergyConfig) -> AxisCompensation:
    """Lowers the paper's E_mask within the released bounds, which only rewards shrinking."""
    from gvla2_plugins.axes.compensations import MaskEnergy

    return MaskEnergy(config.iterations)


@hookimpl
def gvla2_axis_compensations() -> list[Component[AxisCompensation]]:
    """``axis=contours``, ``axis=mask_energy``."""
    return [
        Component("contours", ContoursConfig, _contours),
        Component("mask_energy", MaskEnergyConfig, _mask_energy),
    ]
