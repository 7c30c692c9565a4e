"""3D Gaussians as arrays, in the parametrisation of 3D Gaussian splatting (3DGS), and their PLY files.

float32 ``x y z nx ny nz f_dc_0..2 [f_rest_*] opacity(logit) scale_0..2(log) rot_0..3(wxyz)``.
"""

from __future__ import annotations

import io
import os
import re
from copy import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from plyfile import PlyData, PlyElement, PlyParseError

from gvla2.errors import GeometryError
from gvla2.io.files import write_whole

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
        n = len(np.atleast_1d(self.centres))
        shapes: dict[str, tuple[int, ...]] = {"centres": (n, 3), "log_scales": (n, 3), "rotations": (n, 4)}
        shapes |= {"opacity_logits": (n,), "sh_dc": (n, 3)}
        if self.sh_rest is not None:
            columns = np.shape(self.sh_rest)[-1]
            if columns not in (9, 24, 45):
                raise GeometryError(f"Gaussians: sh_rest must have 9, 24 or 45 columns, got {columns}.")
            shapes["sh_rest"] = (n, columns)
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


_XYZ = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATIONS = ("rot_0", "rot_1", "rot_2", "rot_3")
_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_REQUIRED = (*_XYZ, *_DC, "opacity", *_SCALES, *_ROTATIONS)


def read_gaussians(path: str | os.PathLike[str]) -> Gaussians:
    """The Gaussians of a binary 3DGS file, of either byte order; its further properties and elements are left out.

    Raises :class:`GeometryError`, naming the file, when it is absent, ASCII, truncated, not a PLY file,
    without a property that Gaussians need, or with centres that are not finite.
    """
    source = Path(path)
    try:
        return _gaussians(_vertices(source))
    except (OSError, PlyParseError, ValueError) as error:
        raise GeometryError(f"Cannot read Gaussians from {source}: {error}") from error


def write_gaussians(path: str | os.PathLike[str], gaussians: Gaussians) -> None:
    """Write a new 3DGS file, little-endian, with zero normals as the field's tools expect them.

    Raises :class:`gvla2.errors.OutputError`.
    """
    rest = np.zeros((len(gaussians), 0)) if gaussians.sh_rest is None else gaussians.sh_rest
    columns: dict[str, NDArray[np.floating]] = {name: gaussians.centres[:, i] for i, name in enumerate(_XYZ)}
    columns |= {name: np.zeros(len(gaussians)) for name in ("nx", "ny", "nz")}
    columns |= {name: gaussians.sh_dc[:, i] for i, name in enumerate(_DC)}
    columns |= {f"f_rest_{i}": rest[:, i] for i in range(rest.shape[1])}
    columns["opacity"] = gaussians.opacity_logits
    columns |= {name: gaussians.log_scales[:, i] for i, name in enumerate(_SCALES)}
    columns |= {name: gaussians.rotations[:, i] for i, name in enumerate(_ROTATIONS)}
    records = np.empty(len(gaussians), dtype=[(name, "<f4") for name in columns])
    for name, column in columns.items():
        records[name] = column
    stream = io.BytesIO()
    PlyData([PlyElement.describe(records, "vertex")], byte_order="<").write(stream)
    write_whole(path, stream.getvalue())


def _vertices(source: Path) -> NDArray[np.void]:
    """The vertex records of a complete file; ValueError and PlyParseError say what is wrong."""
    content = source.read_bytes()
    if re.match(rb"ply\s+(?:(?:comment|obj_info)[^\n]*\n)*format ascii", content):
        raise ValueError("it is an ASCII file and only binary ones are read; save it as binary PLY.")
    ply = PlyData.read(io.BytesIO(content))
    if "vertex" not in ply:
        raise ValueError(f"it has no element 'vertex', only {[element.name for element in ply]}.")
    vertices = ply["vertex"].data
    missing = [name for name in _REQUIRED if name not in (vertices.dtype.names or ())]
    if missing:
        raise ValueError(f"it is not a 3DGS file, its vertices lack {', '.join(missing)}.")
    if len(vertices) == 0:
        raise ValueError("it holds no Gaussians.")
    return np.asarray(vertices)


def _gaussians(records: NDArray[np.void]) -> Gaussians:
    def columns(*names: str) -> NDArray[np.float32]:
        return np.stack([records[name] for name in names], axis=1).astype(np.float32)

    rest = [n for n in records.dtype.names or () if re.fullmatch(r"f_rest_\d+", n)]
    return Gaussians(
        columns(*_XYZ),
        columns(*_SCALES),
        columns(*_ROTATIONS),
        columns("opacity")[:, 0],
        columns(*_DC),
        columns(*sorted(rest, key=lambda n: int(n[7:]))) if rest else None,
    )
