"""The two compensations as :class:`gvla2.reconstruction.contracts.AxisCompensation`."""

from __future__ import annotations

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import AxisFit
from gvla2_plugins.axes.axis import compensate
from gvla2_plugins.axes.options import AxisOptions


class Contours:
    """Gauss-Newton on silhouette contours."""

    def __init__(self, iterations: int, contour_points: int, least_gain: float) -> None:
        self._options = AxisOptions(
            iterations=iterations, contour_points=contour_points, least_gain=least_gain
        )

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The fit, or the identity with a reason."""
        return compensate(points, views, centre, self._options)


class MaskEnergy:
    """The paper's objective, E_mask and its priors."""

    def __init__(self, iterations: int) -> None:
        self._options = AxisOptions(mode="paper", iterations=iterations)

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The fit, or the identity with a reason."""
        return compensate(points, views, centre, self._options)
