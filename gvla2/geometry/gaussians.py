"""3D Gaussians as arrays, in the parametrisation of 3D Gaussian splatting (3DGS)."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError

SH_C0 = 0.2820948
"""The constant spherical harmonic: rgb = 0.5 + SH_C0 * f_dc."""


@dataclass(frozen=True)
class Gaussians:
    """N anisotropic Gaussians with opacity and view-dependent colour; all arrays float32.

    ``centres`` (N, 3) metres, world or object frame; ``log_scales`` (N, 3) natural logarithms of the standard
    deviations in metres along the Gaussian's own axes; ``rotations`` (N, 4) quaternions wxyz that turn these
    axes into the frame of the centres, of any length but zero; ``opacity_logits`` (N,), opacity is their
    sigmoid; ``sh_dc`` (N, 3) constant spherical harmonics; ``sh_rest`` (N, 3k) the higher ones or None, channel
    by channel as in the files (k of red, k of green, k of blue), k = 3, 8 or 15 for degree 1, 2, 3.

    Infinite logits (opacity exactly 0 or 1) and log-scales of -inf (flat) are allowed; raises
    :class:`GeometryError` for wrong shapes, NaN, centres that are not finite and quaternions of length zero.
    """

    centres: NDArray[np.float32]
    log_scales: NDArray[np.float32]
    rotations: NDArray[np.float32]
    opacity_logits: NDArray[np.float32]
    sh_dc: NDArray[np.float32]
    sh_rest: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        centres = np.asarray(self.centres, dtype=np.float32)
        if centres.ndim != 2 or centres.shape[1] != 3:
            raise GeometryError(f"Gaussians: centres must be (N, 3), got shape {centres.shape}.")
        self._stand_at(centres)
        n = len(centres)
        shapes = {"log_scales": (n, 3), "rotations": (n, 4), "opacity_logits": (n,), "sh_dc": (n, 3)}
        for name, shape in shapes.items():
            self._check(name, shape)
        if self.sh_rest is not None:
            columns = np.shape(self.sh_rest)[-1]
            if columns not in (9, 24, 45):
                raise GeometryError(f"Gaussians: sh_rest must have 9, 24 or 45 columns, got {columns}.")
            self._check("sh_rest", (n, columns))
        if not self.rotations.any(axis=1).all():
            raise GeometryError("Gaussians: a rotation quaternion has length zero.")
        if np.isinf(self.rotations).any() or (self.log_scales == np.inf).any():
            raise GeometryError("Gaussians: a rotation or a scale is infinite.")

    def _stand_at(self, centres: NDArray[np.float32]) -> None:
        if not np.isfinite(centres).all():
            count = int((~np.isfinite(centres).all(axis=1)).sum())
            raise GeometryError(f"Gaussians: {count} of {len(centres)} centres are not finite.")
        object.__setattr__(self, "centres", centres)

    def _check(self, name: str, shape: tuple[int, ...]) -> None:
        array = np.asarray(getattr(self, name), dtype=np.float32)
        if array.shape != shape:
            raise GeometryError(f"Gaussians: {name} must have shape {shape}, got {array.shape}.")
        if np.isnan(array).any():
            raise GeometryError(f"Gaussians: {name} contains NaN.")
        object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.centres)

    @property
    def rgb(self) -> NDArray[np.float32]:
        """(N, 3) colour seen from everywhere when there are no higher harmonics; may leave [0, 1]."""
        return np.asarray(0.5 + SH_C0 * self.sh_dc, dtype=np.float32)

    @property
    def opacities(self) -> NDArray[np.float32]:
        """(N,) in [0, 1]."""
        # tanh does not overflow for any logit.
        return np.asarray(0.5 + 0.5 * np.tanh(0.5 * self.opacity_logits), dtype=np.float32)

    @property
    def scales(self) -> NDArray[np.float32]:
        """(N, 3) standard deviations along the Gaussian's own axes, metres."""
        return np.asarray(np.exp(self.log_scales), dtype=np.float32)

    def covariances(self) -> NDArray[np.float64]:
        """(N, 3, 3) square metres, in the frame of the centres: R S S^T R^T."""
        q = self.rotations.astype(np.float64)
        w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        ).transpose(2, 0, 1)
        scaled = rotation * np.exp(self.log_scales.astype(np.float64))[:, None, :]
        return np.asarray(scaled @ scaled.transpose(0, 2, 1))

    def with_centres(self, centres: ArrayLike) -> Gaussians:
        """The same Gaussians at other centres (N, 3); every other array is shared, not copied."""
        moved = np.asarray(centres, dtype=np.float32)
        if moved.shape != self.centres.shape:
            raise GeometryError(f"{len(self)} Gaussians cannot take centres of shape {moved.shape}.")
        made = copy(self)  # what was checked is not checked again
        made._stand_at(moved)
        return made
