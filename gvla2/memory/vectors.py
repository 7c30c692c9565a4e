"""Growable unit vectors: one byte a number to rank all of them quickly, float32 to settle what is near the top."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import simsimd
from numpy.typing import NDArray

from gvla2.memory.growing import grown


class Vectors:
    """(N, D) rows, each of length 1 or zero, quantised with a scale of its own."""

    def __init__(self, dimension: int) -> None:
        self.dimension = dimension
        self.exact = np.zeros((0, dimension), np.float32)  # (N, D)
        self.codes = np.zeros((0, dimension), np.int8)  # (N, D) round(exact / scale)
        self.scale = np.zeros(0, np.float64)  # (N,)
        self._last: tuple[bytes, tuple[NDArray[np.int8], float, float]] | None = None
        self.error = 0.0  # largest |exact - scale * codes| of any row

    def put(self, first: int, rows: NDArray[np.float32]) -> None:
        """Set rows ``first``, ``first + 1``, ... to ``rows`` (K, D), in place or behind the last."""
        last = first + len(rows)
        asked = self._last
        self.exact, self.codes = grown(self.exact, last), grown(self.codes, last)
        self.scale = grown(self.scale, last)
        if len(rows) == 1 and asked is not None and asked[0] == rows.tobytes():
            codes, one, error = asked[1]  # what is learnt was compared with the others just before
            self.exact[first], self.codes[first], self.scale[first] = rows[0], codes[0], one
            self.error = max(self.error, error)
            return
        codes, scale = quantised(rows)
        self.exact[first:last], self.codes[first:last], self.scale[first:last] = rows, codes, scale
        for start in range(0, len(rows), 4096):  # a few megabytes at a time
            part = slice(start, start + 4096)
            self.error = max(self.error, float(_errors(rows[part], codes[part], scale[part]).max()))

    def near(self, vector: NDArray[np.float32], rows: int) -> NDArray[np.float64]:
        """(N,) cosines of the first ``rows`` rows with a unit (D,) vector, to within :meth:`slack`."""
        codes, scale, _ = self._asked(vector)
        if not rows or not scale:
            return np.zeros(rows)
        products = np.asarray(simsimd.cdist(codes, self.codes[:rows], metric="dot")).reshape(rows)
        products *= self.scale[:rows]
        products *= scale
        return products

    def slack(self, vector: NDArray[np.float32]) -> float:
        """The most that :meth:`near` may be off, by the inequality of Cauchy and Schwarz."""
        _, _, own = self._asked(vector)
        # |q.x - q'.x'| <= |q'| |x - x'| + |q - q'| |x|, and 1e-6 for the rounding of float32.
        return (math.sqrt(float(vector @ vector)) + own) * self.error + own + 1e-6

    def cosines(self, vector: NDArray[np.float32], rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """(K,) cosines of these rows, in float32's precision."""
        found = np.empty(len(rows))
        for start in range(0, len(rows), 4096):  # not all of a large bank copied at once
            found[start : start + 4096] = self.exact[rows[start : start + 4096]] @ vector
        return found

    def _asked(self, vector: NDArray[np.float32]) -> tuple[NDArray[np.int8], float, float]:
        """The (1, D) codes, the scale and the error of a query's vector; it is asked for several times in a row."""
        key = vector.tobytes()
        if self._last is None or self._last[0] != key:
            # As in :func:`quantised`, without what only many rows need.
            scale = float(np.abs(vector).max(initial=0.0)) / 127.0
            inverse = np.float32(1.0 / scale if scale else 0.0)
            codes = np.rint(vector * inverse).astype(np.int8)
            rest = vector - codes * scale
            self._last = key, (codes[None], scale, math.sqrt(float(rest @ rest)))
        return self._last[1]

    def compact(self, kept: NDArray[np.int64]) -> None:
        """Keep these rows alone, in this order."""
        self.exact, self.codes, self.scale = self.exact[kept], self.codes[kept], self.scale[kept]

    def arrays(self, rows: int) -> dict[str, NDArray[np.generic]]:
        """The state of the first ``rows`` rows."""
        return {"exact": self.exact[:rows], "codes": self.codes[:rows], "scale": self.scale[:rows]}

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[np.generic]], error: float) -> Vectors:
        """Vectors from :meth:`arrays` and the largest error."""
        made = cls(arrays["exact"].shape[1])
        for name, array in arrays.items():
            setattr(made, name, array)
        made.error = error
        return made


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
