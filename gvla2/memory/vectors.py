"""Growable unit vectors: one byte a number to rank all of them quickly, float32 to settle what is near the top."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import simsimd
from numpy.typing import NDArray

from gvla2.memory.growing import grown


_TOGETHER = 64
_HELD = 1 << 20
_ROWS = 1024
"""Rows that are multiplied by many queries in a row: half a megabyte of codes, which a processor keeps at hand."""


class Vectors:
    """(N, D) rows, each of length 1 or zero, quantised with a scale of its own."""

    def __init__(self, dimension: int) -> None:
        self.dimension = dimension
        self.exact = np.zeros((0, dimension), np.float32)  # (N, D)
        self.codes = np.zeros((0, dimension), np.int8)  # (N, D) round(exact / scale)
        self.scale = np.zeros(0, np.float64)  # (N,)
        self._last: tuple[bytes, tuple[NDArray[np.int8], float, float]] | None = None
        self.error = 0.0  # largest |exact - scale * codes| of any row
        self._expected: list[NDArray[np.float32]] = []
        self._ahead: dict[bytes, NDArray[np.float64]] = {}

    def put(self, first: int, rows: NDArray[np.float32]) -> None:
        """Set rows ``first``, ``first + 1``, ... to ``rows`` (K, D), in place or behind the last."""
        last = first + len(rows)
        asked = self._last
        self.expect(())
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
        if self._expected and (found := self._foreseen(vector, rows)) is not None:
            return found
        codes, scale, _ = self._asked(vector)
        if not rows or not scale:
            return np.zeros(rows)
        products = np.asarray(simsimd.cdist(codes, self.codes[:rows], metric="dot")).reshape(rows)
        products *= self.scale[:rows]
        products *= scale
        return products

    def expect(self, vectors: Sequence[NDArray[np.float32]]) -> None:
        """Unit (D,) vectors that :meth:`near` will be asked for in this order, while no row changes."""
        self._expected = list(vectors) if len(vectors) > 1 else []
        self._ahead = {}

    def _foreseen(self, vector: NDArray[np.float32], rows: int) -> NDArray[np.float64] | None:
        """What :meth:`near` gives, computed for many expected vectors at a time: rows are then fetched once."""
        key = vector.tobytes()
        found = self._ahead.get(key)
        if found is not None:
            return found if len(found) == rows else None
        place = next((i for i, other in enumerate(self._expected) if other.tobytes() == key), None)
        if place is None or not rows:
            return None
        some = self._expected[place : place + max(1, min(_TOGETHER, _HELD // rows))]
        self._expected = self._expected[place:]
        codes, scale = quantised(np.stack(some))
        products = np.empty((len(some), rows))
        for first in range(0, rows, _ROWS):
            part = slice(first, min(first + _ROWS, rows))
            products[:, part] = simsimd.cdist(codes, self.codes[part], metric="dot")
            products[:, part] *= self.scale[part]
        products *= scale[:, None]
        self._ahead = {other.tobytes(): row for other, row in zip(some, products, strict=True)}
        return self._ahead[key]

    def slack(self, vector: NDArray[np.float32]) -> float:
        """The most that :meth:`near` may be off, by the inequality of Cauchy and Schwarz."""
        _, _, own = self._asked(vector)
        # |q.x - q'.x'| <= |q'| |x - x'| + |q - q'| |x|, and 1e-6 for the rounding of float32.
        return (float(np.sqrt(vector @ vector)) + own) * self.error + own + 1e-6

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
            codes, scale = quantised(vector[None])
            error = float(_errors(vector[None], codes, scale)[0])
            self._last = key, (codes, float(scale[0]), error)
        return self._last[1]

    def compact(self, kept: NDArray[np.int64]) -> None:
        """Keep these rows alone, in this order."""
        self.expect(())
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


def sound(vector: NDArray[np.float32] | None, dimension: int) -> bool:
    """Whether a stored vector may be used: its length right, finite, a unit row or zero."""
    if vector is None or vector.shape != (dimension,) or not np.isfinite(vector).all():
        return False
    length = float(np.linalg.norm(vector))
    return length == 0.0 or abs(length - 1.0) < 1e-2
