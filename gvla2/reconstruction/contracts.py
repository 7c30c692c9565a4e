"""Protocols of the reconstruction branch's components: reconstructor, prior, axis, fusion, renderer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views


@dataclass(frozen=True)
class Reconstruction:
    """An object's geometry in the world frame, metres: Gaussians, a mesh, or both.

    ``status`` is ``"ok"`` or a typed reason why less was done than asked, for the run's page.
    """

    gaussians: Gaussians | None
    mesh: TriangleMesh | None
    status: str = "ok"


@dataclass(frozen=True)
class StageReport:
    """What one stage of the branch did, and why: nothing falls back in silence.

    ``status``: ``applied``, ``partial`` (applied to a part of the points), ``rejected`` (a gate kept the input),
    ``fallback`` (another way was taken) or ``skipped`` (switched off, or there was nothing to do). ``reason`` is a
    sentence; ``before`` and ``after`` hold the stage's own measures by name (symmetric IoU, mean support, ...);
    ``seconds`` of wall time are filled in by the branch.
    """

    stage: str
    status: Literal["applied", "partial", "rejected", "fallback", "skipped"]
    reason: str = ""
    before: Mapping[str, float] = field(default_factory=dict)
    after: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class GeometryEstimate:
    """A prior's answer for S views, in a frame and scale of its own.

    ``depth`` (S, H, W) float32 along each camera's z, NaN where unknown; ``confidence`` (S, H, W) >= 0;
    ``world_from_camera`` (S, 4, 4) in the prior's frame, or None when the depth is already metric and calibrated.
    """

    depth: NDArray[np.float32]
    confidence: NDArray[np.float32]
    world_from_camera: FloatArray | None = None


@dataclass(frozen=True)
class AxisFit:
    """T(p) = c + (p - c) * a + d (paper, axis compensation).

    ``scale`` a (3,) and ``shift`` d (3,) metres about ``centre`` (3,), along the world's axes. When not ``accepted``,
    a = 1 and d = 0 and ``reason`` says why; ``iou_before`` and ``iou_after`` are the symmetric IoU of the input and of
    the found shape (NaN when no mask shows anything).
    """

    scale: FloatArray
    shift: FloatArray
    accepted: bool
    iou_before: float
    iou_after: float
    iterations: int
    reason: str
    centre: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """T(p) of world points (N, 3), metres, for Gaussians and mesh alike; the points themselves if not accepted."""
        if not self.accepted:
            return points
        return np.asarray(points * self.scale + (self.centre + self.shift - self.scale * self.centre))


class Reconstructor(Protocol):
    """Makes the first object G0 of the branch from masked views."""

    def reconstruct(self, views: Views) -> Reconstruction | None:
        """The object seen in the views' masks; None when this reconstructor does nothing (``none``)."""
        ...


class GeometryPrior(Protocol):
    """Predicts depth for the views from outside knowledge; the branch verifies it before use."""

    def predict(self, views: Views) -> GeometryEstimate | None:
        """One depth map a view; None when there is no prior (``none``)."""
        ...


class AxisCompensation(Protocol):
    """Finds one scale an axis and one shift that make a shape fill its masks: source B of the branch."""

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The fit for points (N, 3) of the surface, metres, world, about ``centre`` (3,)."""
        ...


class FusionStrategy(Protocol):
    """Fuses the geometry of source A with that of source B; everything but xyz stays A's."""

    def fuse(self, a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """Fused centres (N, 3) from centres (N, 3) of both sources and their mask support (N,) in [0, 1]."""
        ...


class Renderer(Protocol):
    """Renders Gaussians into a camera."""

    def render(
        self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Image (H, W, 3) and alpha (H, W), both float32 in [0, 1]."""
        ...
