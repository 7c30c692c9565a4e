"""Gaussians in PLY files, in the layout of 3D Gaussian splatting.

float32 ``x y z nx ny nz f_dc_0..2 [f_rest_*] opacity(logit) scale_0..2(log) rot_0..3(wxyz)``. Other tools add
properties of their own, so a file that was read is changed in place: only xyz, every other byte is kept.
"""

from __future__ import annotations

import io
import os
import re
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from plyfile import PlyData, PlyElement, PlyParseError

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import Gaussians
from gvla2.io.files import write_whole

_XYZ = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATIONS = ("rot_0", "rot_1", "rot_2", "rot_3")
_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_REQUIRED = (*_XYZ, *_DC, "opacity", *_SCALES, *_ROTATIONS)


@dataclass(frozen=True)
class GaussianPly:
    """A PLY file of Gaussians held in memory: its meaning, and the bytes that it was read from."""

    gaussians: Gaussians
    _content: bytes = field(repr=False)
    _dtype: np.dtype[np.void] = field(repr=False)
    _offset: int = field(repr=False)  # of the first vertex in the content, bytes

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> GaussianPly:
        """Read a binary 3DGS file, of either byte order, with any further properties and elements.

        Raises :class:`GeometryError`, naming the file, when it is absent, ASCII, truncated, not a PLY file,
        without a property that Gaussians need, or with centres that are not finite.
        """
        source = Path(path)
        try:
            content = source.read_bytes()
            vertices = _vertices(source, content)
            gaussians = _gaussians(vertices)
        except (OSError, PlyParseError, ValueError) as error:
            raise GeometryError(f"Cannot read Gaussians from {source}: {error}") from error
        return cls(gaussians, content, vertices.dtype, int(vertices.offset))

    def with_centres(self, centres: ArrayLike) -> GaussianPly:
        """The same file with other centres (N, 3), metres."""
        return replace(self, gaussians=self.gaussians.with_centres(centres))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file whole or not at all: the bytes that were read, except for changed centres.

        Raises :class:`gvla2.errors.OutputError`.
        """
        content = bytearray(self._content)
        centres = self.gaussians.centres
        records = np.frombuffer(content, self._dtype, len(centres), self._offset)
        for axis, name in enumerate(_XYZ):
            # A file may hold doubles: unmoved centres keep all their digits.
            moved = centres[:, axis] != records[name].astype(np.float32)
            np.copyto(records[name], centres[:, axis], where=moved)
        write_whole(path, content)


def read_gaussians(path: str | os.PathLike[str]) -> Gaussians:
    """The Gaussians of a 3DGS file; errors as in :meth:`GaussianPly.read`."""
    return GaussianPly.read(path).gaussians


def write_gaussians(path: str | os.PathLike[str], gaussians: Gaussians) -> None:
    """Write a new 3DGS file, little-endian, with zero normals as the field's tools expect them.

    Raises :class:`gvla2.errors.OutputError`. To change a file that exists, use :class:`GaussianPly`.
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


def _vertices(source: Path, content: bytes) -> np.memmap[tuple[int], np.dtype[np.void]]:
    """The vertex records as they lie in a complete file; ValueError and PlyParseError say what is wrong."""
    if re.match(rb"ply\s+(?:(?:comment|obj_info)[^\n]*\n)*format ascii", content):
        raise ValueError("it is an ASCII file and only binary ones are read; save it as binary PLY.")
    ply = PlyData.read(str(source))  # maps the file, so this reads only the header
    if "vertex" not in ply:
        raise ValueError(f"it has no element 'vertex', only {[element.name for element in ply]}.")
    vertices = ply["vertex"].data
    missing = [name for name in _REQUIRED if name not in (vertices.dtype.names or ())]
    if missing:
        raise ValueError(f"it is not a 3DGS file, its vertices lack {', '.join(missing)}.")
    if len(vertices) == 0:
        raise ValueError("it holds no Gaussians.")
    if not isinstance(vertices, np.memmap):
        raise ValueError("its vertices have properties of varying length.")
    return vertices


def _gaussians(records: NDArray[np.void]) -> Gaussians:
    names = records.dtype.names or ()
    rest = sorted((n for n in names if re.fullmatch(r"f_rest_\d+", n)), key=lambda n: int(n[7:]))
    return Gaussians(
        centres=_columns(records, _XYZ),
        log_scales=_columns(records, _SCALES),
        rotations=_columns(records, _ROTATIONS),
        opacity_logits=_columns(records, ("opacity",))[:, 0],
        sh_dc=_columns(records, _DC),
        sh_rest=_columns(records, tuple(rest)) if rest else None,
    )


def _columns(records: NDArray[np.void], names: tuple[str, ...]) -> NDArray[np.float32]:
    """(N, len(names)) float32; one copy where the file has them side by side, as all tools write them."""
    fields = records.dtype.fields
    assert fields is not None  # the caller has found the names there
    kind, offsets = zip(*(fields[name][:2] for name in names), strict=True)
    steps = {b - a for a, b in pairwise(offsets)}
    if set(kind) == {np.dtype("<f4")} and steps <= {4}:
        block = np.ndarray(
            (len(records), len(names)), "<f4", records.data, offsets[0], (records.dtype.itemsize, 4)
        )
        return np.ascontiguousarray(block, dtype=np.float32)
    return np.stack([records[name] for name in names], axis=1).astype(np.float32)
