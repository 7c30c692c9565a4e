"""3D Gaussians as arrays, in the parametrisation of 3D Gaussian splatting (3DGS), and their PLY files.

float32 ``x y z nx ny nz f_dc_0..2 opacity(logit) scale_0..2(log) rot_0..3(wxyz)``.
"""

from __future__ import annotations

import io
import os
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from plyfile import PlyData, PlyElement

from gvla2.errors import GeometryError, reading
from gvla2.io.files import write_whole

SH_C0 = 0.2820948
"""The constant spherical harmonic: rgb = 0.5 + SH_C0 * f_dc."""


@dataclass(frozen=True)
class Gaussians:
    """N anisotropic Gaussians with opacity and a colour that looks the same from everywhere; all arrays float32.

    ``centres`` (N, 3) metres, world or object frame; ``log_scales`` (N, 3) natural logarithms of the standard
    deviations in metres along the Gaussian's own axes; ``rotations`` (N, 4) quaternions wxyz that turn these
    axes into the frame of the centres, of any length but zero; ``opacity_logits`` (N,), opacity is their
    sigmoid; ``sh_dc`` (N, 3) constant spherical harmonics.

    Infinite logits (opacity exactly 0 or 1) and log-scales of -inf (flat) are allowed; raises
    :class:`GeometryError` for wrong shapes, NaN, centres that are not finite and quaternions of length zero.
    """

    centres: NDArray[np.float32]
    log_scales: NDArray[np.float32]
    rotations: NDArray[np.float32]
    opacity_logits: NDArray[np.float32]
    sh_dc: NDArray[np.float32]

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.centres))
        shapes: dict[str, tuple[int, ...]] = {"centres": (n, 3), "log_scales": (n, 3), "rotations": (n, 4)}
        shapes |= {"opacity_logits": (n,), "sh_dc": (n, 3)}
        for name, shape in shapes.items():
            array = np.asarray(getattr(self, name), dtype=np.float32)
            if array.shape != shape:
                raise GeometryError(f"Gaussians: {name} must have shape {shape}, got {array.shape}.")
            if np.isnan(array).any():
                raise GeometryError(f"Gaussians: {name} contains NaN.")
            object.__setattr__(self, name, array)
        if not self.rotations.any(axis=1).all():
            raise GeometryError("Gaussians: a rotation quaternion has length zero.")
        infinite = np.isinf(self.centres).any() or np.isinf(self.rotations).any()
        if infinite or (self.log_scales == np.inf).any():
            raise GeometryError("Gaussians: a centre, a rotation or a scale is infinite.")

    def __len__(self) -> int:
        return len(self.centres)

    @property
    def rgb(self) -> NDArray[np.float32]:
        """(N, 3) colour; may leave [0, 1]."""
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

    def with_centres(self, centres: ArrayLike) -> Gaussians:
        """The same Gaussians at other centres (N, 3); every other array is shared, not copied."""
        moved = np.asarray(centres, dtype=np.float32)
        if moved.shape != self.centres.shape:
            raise GeometryError(f"{len(self)} Gaussians cannot take centres of shape {moved.shape}.")
        if not np.isfinite(moved).all():
            raise GeometryError("Gaussians: a centre is not finite.")
        made = copy(self)  # what was checked is not checked again
        object.__setattr__(made, "centres", moved)
        return made


_COLUMNS = {
    "centres": ("x", "y", "z"),
    "sh_dc": ("f_dc_0", "f_dc_1", "f_dc_2"),
    "opacity_logits": ("opacity",),
    "log_scales": ("scale_0", "scale_1", "scale_2"),
    "rotations": ("rot_0", "rot_1", "rot_2", "rot_3"),
}
"""The properties of a file's vertices that hold each array, in the files' order."""


def read_gaussians(path: str | os.PathLike[str]) -> Gaussians:
    """The Gaussians of a 3DGS file; its further properties (higher harmonics) and elements are left out.

    Raises :class:`GeometryError`, naming the file, when it is absent, truncated, not a PLY file, without a property
    that Gaussians need, or with centres that are not finite.
    """
    source = Path(path)
    with reading("Gaussians", source):
        ply = PlyData.read(io.BytesIO(source.read_bytes()))
        vertices: Any = ply["vertex"].data if "vertex" in ply else np.zeros(0)
        names = [name for names in _COLUMNS.values() for name in names]
        if missing := [name for name in names if name not in (vertices.dtype.names or ())]:
            raise GeometryError(f"it is not a 3DGS file, its vertices lack {', '.join(missing)}.")
        if len(vertices) == 0:
            raise GeometryError("it holds no Gaussians.")
        arrays = {
            array: np.stack([vertices[name] for name in names], axis=1).astype(np.float32)
            for array, names in _COLUMNS.items()
        }
        return Gaussians(**(arrays | {"opacity_logits": arrays["opacity_logits"][:, 0]}))


def write_gaussians(path: str | os.PathLike[str], gaussians: Gaussians) -> None:
    """Write a new 3DGS file, little-endian, with zero normals as the field's tools expect them.

    Raises :class:`gvla2.errors.OutputError`.
    """
    given = {array: np.asarray(getattr(gaussians, array)).reshape(len(gaussians), -1) for array in _COLUMNS}
    columns = {name: given[array][:, k] for array, names in _COLUMNS.items() for k, name in enumerate(names)}
    order = [*_COLUMNS["centres"], "nx", "ny", "nz", *list(columns)[3:]]
    records = np.zeros(len(gaussians), dtype=[(name, "<f4") for name in order])
    for name, column in columns.items():
        records[name] = column
    stream = io.BytesIO()
    PlyData([PlyElement.describe(records, "vertex")], byte_order="<").write(stream)
    write_whole(path, stream.getvalue())
