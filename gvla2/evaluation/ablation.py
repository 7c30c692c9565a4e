"""The ablation of the reconstruction branch on one object: its rows, the planted drift and the prior's noise.

Carving from calibrated views has no drift of its own; reconstructions of generative models do. Rows made with a planted
drift are labelled as such and never mixed with others.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.branch import BranchComponents, refine_geometry
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.options import REFERENCE, BranchOptions


def _learned(**errors: float) -> Mapping[str, Any]:
    """A learned prior's errors; those that are not named are zero."""
    none = {
        "global_scale": 0.0, "view_scale": 0.0, "view_shift": 0.0, "low_frequency": 0.0, "slope": 0.0,
        "pose_degrees": 0.0, "pose_shift": 0.0, "edge_blur": 0.0, "outliers": 0.0, "confidence": 0.5,
    }  # fmt: skip
    return {"noise": "learned", "learned": {**none, **errors}}


NOISES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "exact": {"noise": "exact"},
        "sensor": {"noise": "sensor"},
        "low0.5": _learned(low_frequency=0.005),
        "low1": _learned(low_frequency=0.01),
        "low2": _learned(low_frequency=0.02),
        "low4": _learned(low_frequency=0.04),
        "view3": _learned(view_scale=0.03),
        "view10": _learned(view_scale=0.10),
        "slope20": _learned(slope=0.20),
        "vggt": {"noise": "learned"},
        "vggt_outliers": _learned(
            global_scale=0.3,
            low_frequency=0.01,
            pose_degrees=1.0,
            pose_shift=0.01,
            edge_blur=1.0,
            outliers=0.03,
        ),
    }
)
"""Errors of the prior's depth by name: options of ``prior=depth``. A sensor is an L515."""


@dataclass(frozen=True)
class DriftSize:
    """How large a drift may be: each is drawn uniformly up to this bound, both ways.

    ``axes``: scale of each axis by itself; ``scale``: of all together; ``degrees``: the turn about a random axis;
    ``shift``: along each axis, as a share of the object's longest side.
    """

    axes: float = 0.0
    scale: float = 0.0
    degrees: float = 0.0
    shift: float = 0.0


DRIFTS: Mapping[str, DriftSize | None] = MappingProxyType(
    {"none": None, "planted": DriftSize(axes=0.04, scale=0.02, degrees=2.0, shift=0.02)}
)
"""The drifts by name; ``planted`` is a Sim(3) and an axis drift at once."""


@dataclass(frozen=True)
class Drift:
    """p' = c + R diag(a) (p - c) + t about an object's centre c.

    ``scale`` a (3,), ``rotation`` R (3, 3), ``shift`` t (3,) for a longest side of 1.
    """

    scale: FloatArray
    rotation: FloatArray
    shift: FloatArray

    @classmethod
    def drawn(cls, size: DriftSize, name: str, seed: int) -> Drift:
        """The drift of an object and a seed; the same everywhere."""
        number = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
        rng = np.random.default_rng([number, seed])
        scale = (1 + rng.uniform(-size.axes, size.axes, 3)) * (1 + rng.uniform(-size.scale, size.scale))
        axis = rng.normal(size=3)
        angle = np.radians(rng.uniform(-size.degrees, size.degrees))
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        return cls(scale, turn.as_matrix(), rng.uniform(-size.shift, size.shift, 3))

    def move(self, points: FloatArray, centre: FloatArray) -> FloatArray:
        """Drifted points (N, 3)."""
        return np.asarray(centre + (points - centre) * self.scale @ self.rotation.T + self.shift)

    def applied(self, g0: Reconstruction) -> Reconstruction:
        """The reconstruction, drifted about the centre of its bounding box: one for Gaussians and mesh.

        Gaussians turn with R and grow by the geometric mean of the scales; their view-dependent colour stays.
        """
        gaussians, mesh = g0.gaussians, g0.mesh
        if gaussians is not None and len(gaussians):
            points = gaussians.centres.astype(np.float64)
        elif mesh is not None and len(mesh.vertices):
            points = mesh.vertices
        else:
            return g0
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        if gaussians is not None and len(gaussians):
            own = Rotation.from_quat(gaussians.rotations.astype(np.float64), scalar_first=True)
            turned = (Rotation.from_matrix(self.rotation) * own).as_quat(scalar_first=True)
            gaussians = replace(
                gaussians.with_centres(self.move(points, centre)),
                log_scales=gaussians.log_scales + np.float32(np.log(self.scale).mean()),
                rotations=turned.astype(np.float32),
            )
        if mesh is not None:
            mesh = mesh.with_vertices(self.move(mesh.vertices, centre))
        return replace(g0, gaussians=gaussians, mesh=mesh)


def refined_row(
    variant: str, g0: Reconstruction, views: Views, components: BranchComponents, options: BranchOptions
) -> tuple[Reconstruction, dict[str, Any]]:
    """A row's reconstruction from a (drifted) G0, and its notes."""
    if variant == REFERENCE:
        return g0, {"g0_status": g0.status}
    refined = refine_geometry(g0, views, components, options.row(variant))
    return refined.out, {"stages": [f"{stage.stage}: {stage.status}" for stage in refined.stages]}
