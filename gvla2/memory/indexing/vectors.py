"""Growable unit vectors: one byte a number to rank all of them quickly, float32 to settle what is near the top."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.memory.indexing.growing import grown
from gvla2.memory.indexing.vector_kernels import cosines, keep, products, quantise

BLOCK = 4096
"""Rows whose codes lie together; a bank that is smaller has one block that grows."""
_FEW = 64


class _Asked(NamedTuple):
    """A query's vector, quantised, and how far the cosines of any row are off by that."""

    key: bytes
    codes: NDArray[np.int8]  # (D,)
    scale: float
    error: float
    length: float


class Vectors:
    """(N, D) rows, each of length 1 or zero, quantised with a scale of its own."""

    def __init__(self, dimension: int) -> None:
        self.dimension = dimension
        self.exact = np.zeros((0, dimension), np.float32)  # (N, D)
        self.codes = np.zeros((1, dimension, _FEW), np.int8)  # (blocks, D, rows) round(exact / scale)
        self.scale = np.zeros(0, np.float64)  # (N,)
        self._last: _Asked | None = None
        self.error = 0.0  # largest |exact - scale * codes| of any row

    def put(self, first: int, rows: NDArray[np.float32]) -> None:
        """Set rows ``first``, ``first + 1``, ... to ``rows`` (K, D), in place or behind the last."""
        last = first + len(rows)
        asked = self._last
        self.exact, self.scale = grown(self.exact, last), grown(self.scale, last)
        self.codes = _with_room(self.codes, last)
        if len(rows) == 1 and asked is not None and asked.key == rows.tobytes():
            # What is learnt was compared with the others just before.
            self.exact[first], self.scale[first] = rows[0], asked.scale
            self._set_codes(first, asked.codes[None])
            self.error = max(self.error, asked.error)
            return
        codes, scale = quantised(rows)
        self.exact[first:last], self.scale[first:last] = rows, scale
        self._set_codes(first, codes)
        for start in range(0, len(rows), 4096):  # a few megabytes at a time
            part = slice(start, start + 4096)
            self.error = max(self.error, float(_errors(rows[part], codes[part], scale[part]).max()))

    def near(self, vector: NDArray[np.float32], rows: int) -> NDArray[np.float64]:
        """(N,) cosines of the first ``rows`` rows with a unit (D,) vector, to within :meth:`slack`."""
        asked = self._asked(vector)
        found = np.empty(rows)
        products(self.codes, asked.codes, self.scale, asked.scale, found)
        return found

    def slack(self, vector: NDArray[np.float32]) -> float:
        """The most that :meth:`near` may be off, by the inequality of Cauchy and Schwarz."""
        asked = self._asked(vector)
        # |q.x - q'.x'| <= |q'| |x - x'| + |q - q'| |x|, and 1e-6 for the rounding of float32.
        return (asked.length + asked.error) * self.error + asked.error + 1e-6

    def cosines(self, vector: NDArray[np.float32], rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """(K,) cosines of these rows, in float32's precision."""
        self._check(vector)
        found = np.empty(len(rows))
        cosines(self.exact, rows, vector, found)
        return found

    def _asked(self, vector: NDArray[np.float32]) -> _Asked:
        """A query's vector is asked for several times in a row."""
        key = vector.tobytes()
        if self._last is None or self._last.key != key:
            self._check(vector)
            codes = np.empty(self.dimension, np.int8)
            self._last = _Asked(key, codes, *quantise(vector, codes))
        return self._last

    def _check(self, vector: NDArray[np.float32]) -> None:
        if vector.shape != (self.dimension,):
            raise ConfigurationError(
                f"A vector of shape {vector.shape} was asked for among vectors of {self.dimension} numbers: give a "
                "vector of the embedder that the bank was opened with."
            )

    def _set_codes(self, first: int, codes: NDArray[np.int8]) -> None:
        """Set the codes of rows ``first``, ... to ``codes`` (K, D)."""
        block, done = self.codes.shape[2], 0
        while done < len(codes):
            b, start = divmod(first + done, block)
            part = codes[done : done + block - start]
            self.codes[b, :, start : start + len(part)] = part.T
            done += len(part)

    def compact(self, kept: NDArray[np.int64]) -> None:
        """Keep these rows alone, in this order."""
        codes = _with_room(np.zeros((1, self.dimension, _FEW), np.int8), len(kept))
        keep(self.codes, kept, codes)
        self.exact, self.codes, self.scale = self.exact[kept], codes, self.scale[kept]

    def arrays(self, rows: int) -> dict[str, NDArray[np.generic]]:
        """The state of the first ``rows`` rows."""
        blocks = max(-(-rows // self.codes.shape[2]), 1)
        return {"exact": self.exact[:rows], "codes": self.codes[:blocks], "scale": self.scale[:rows]}

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[np.generic]], error: float) -> Vectors:
        """Vectors from :meth:`arrays` and the largest error."""
        made = cls(arrays["exact"].shape[1])
        for name, array in arrays.items():
            setattr(made, name, array)
        made.error = error
        return made


def _with_room(codes: NDArray[np.int8], rows: int) -> NDArray[np.int8]:
    """``codes`` itself where it has room for as many rows, else a larger copy: with twice the room, then with half as
    many blocks more.
    """
    blocks, dimension, block = codes.shape
    if blocks * block >= rows:
        return codes
    if rows <= BLOCK:
        larger = np.zeros((1, dimension, min(max(rows, 2 * block), BLOCK)), np.int8)
    else:
        larger = np.zeros((max(-(-rows // BLOCK), blocks + blocks // 2), dimension, BLOCK), np.int8)
    larger[:blocks, :, :block] = codes
    return larger


def quantised(rows: NDArray[np.float32]) -> tuple[NDArray[np.int8], NDArray[np.float64]]:
    """((K, D) codes, (K,) scales): rows are about scale x codes."""
    scale = np.abs(rows).max(axis=1, initial=0.0).astype(np.float64) / 127.0
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    return np.rint(rows * inverse[:, None].astype(np.float32)).astype(np.int8), scale


def _errors(
    rows: NDArray[np.float32], codes: NDArray[np.int8], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(rows - codes * scale[:, None], axis=1))


def sound(rows: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(K,) whether stored (K, D) vectors may be used: finite, and unit rows or zero."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.einsum("kd,kd->k", rows, rows, dtype=np.float64)
    return np.asarray((squares == 0.0) | (np.abs(np.sqrt(squares) - 1.0) < 1e-2))
