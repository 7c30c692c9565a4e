"""The input views with what all stages ask of them, computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import hull_field, surface_of
from gvla2.reconstruction.mask_distance import Silhouette, silhouettes
from gvla2.reconstruction.occupancy import Field
from gvla2.reconstruction.support import MaskStack, as_points, mask_of
from gvla2.reconstruction.zbuffer import depth_maps


@dataclass(frozen=True, eq=False)
class ViewSet:
    """Views D = {(I_i, M_i, K_i, T_i)} that all have masks; raises :class:`GeometryError` where one has none."""

    views: Views
    compat: str = "none"

    def __post_init__(self) -> None:
        for view in self.views:
            mask_of(view)
            u, v = view.camera.K[:2, 2]
            if not (0 <= u <= view.camera.width and 0 <= v <= view.camera.height):
                raise GeometryError(
                    f"View '{view.name}': the principal point ({u:g}, {v:g}) lies outside its picture of "
                    f"{view.camera.width}x{view.camera.height} pixels. Was it cropped or resized, and K not?"
                )
        names = [view.name for view in self.views]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise GeometryError(
                f"Views are told apart by their names, and {', '.join(doubled)} stands twice."
            )

    @cached_property
    def _stack(self) -> MaskStack:
        return MaskStack.of(self.views, self.compat)

    def support(self, points: FloatArray) -> FloatArray:
        """s(p) (N,) of points (N, 3) (paper, mask-consistency score)."""
        return self._stack.support(as_points(points))

    @cached_property
    def silhouettes(self) -> tuple[Silhouette, ...]:
        """The masks as signed distances, less the empty ones."""
        return silhouettes(self.views)[0]

    @cached_property
    def rays(self) -> tuple[FloatArray, ...]:
        """Each view's world directions (H, W, 3) of its pixels, of depth 1."""
        return tuple(view.camera.rays()[1] for view in self.views)

    @cached_property
    def hull(self) -> Field:
        """The masks' visual hull."""
        return hull_field(self.views)

    @cached_property
    def hull_surface(self) -> TriangleMesh:
        """The zero of :attr:`hull`."""
        return surface_of(self.hull)

    @cached_property
    def hull_interval(self) -> tuple[FloatArray, FloatArray]:
        """Depths (S, H, W), metres, between which the hull lies on each pixel's ray, NaN where it is missed."""
        cameras = [view.camera for view in self.views]
        front = np.stack(depth_maps(self.hull_surface, cameras)).astype(np.float64)
        back = np.stack(depth_maps(self.hull_surface, cameras, farthest=True)).astype(np.float64)
        missed = ~np.isfinite(front)
        return np.where(missed, np.nan, front), np.where(missed, np.nan, back)
