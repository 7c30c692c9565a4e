"""The drift stress test: a known error of scale, rotation and shift, applied to a first reconstruction.

Carving from calibrated views has no drift of its own; reconstructions of generative models do. Rows made with a planted
drift are labelled as such and never mixed with others.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.contracts import Reconstruction


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
    {
        "none": None,
        "planted": DriftSize(axes=0.04, scale=0.02, degrees=2.0, shift=0.02),
        "axis": DriftSize(axes=0.05, shift=0.02),
        "sim3": DriftSize(scale=0.05, degrees=3.0, shift=0.02),
    }
)
"""The drifts by name; ``planted`` is a Sim(3) and an axis drift at once."""


@dataclass(frozen=True)
class Drift:
    """p' = c + R diag(a) (p - c) + t about an object's centre c.

    ``scale`` a (3,), ``rotation`` R (3, 3), ``shift`` t (3,).
    """

    scale: FloatArray
    rotation: FloatArray
    shift: FloatArray

    @classmethod
    def drawn(cls, size: DriftSize, name: str, seed: int) -> Drift:
        """The drift of an object and a seed; the same everywhere. ``shift`` is for a longest side of 1."""
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

    def applied(self, thing: Reconstruction) -> Reconstruction:
        """The reconstruction, drifted about the centre of its bounding box.

        Gaussians turn with R and grow by the geometric mean of the scales; their view-dependent colour stays.
        """
        gaussians, mesh = thing.gaussians, thing.mesh
        # One centre for Gaussians and mesh: they must not come apart.
        if gaussians is not None and len(gaussians):
            points = gaussians.centres.astype(np.float64)
        elif mesh is not None and len(mesh.vertices):
            points = mesh.vertices
        else:
            return thing
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        if gaussians is not None:
            gaussians = self._drifted(gaussians, centre)
        if mesh is not None:
            mesh = mesh.with_vertices(self.move(mesh.vertices, centre))
        return replace(thing, gaussians=gaussians, mesh=mesh)

    def _drifted(self, gaussians: Gaussians, centre: FloatArray) -> Gaussians:
        turned = gaussians.rotations
        if len(gaussians):
            own = Rotation.from_quat(gaussians.rotations.astype(np.float64), scalar_first=True)
            turned = (Rotation.from_matrix(self.rotation) * own).as_quat(scalar_first=True).astype(np.float32)
        growth = np.float32(np.log(self.scale).mean())
        return replace(
            gaussians.with_centres(self.move(gaussians.centres.astype(np.float64), centre)),
            log_scales=gaussians.log_scales + growth,
            rotations=turned,
        )
