"""The compiled loops over quantised vectors, which lie in blocks of rows, one dimension after the other.

So a query touches no more of them than the dimensions that it has: most texts are short, and few n-grams occur in
them. What is read of a block is read in order, sixteen rows at once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Any: numba's decorator leaves no types behind.


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def quantise(vector: Any, codes: Any) -> Any:
    """Set ``codes`` (D,) int8 to ``vector`` (D,) divided by its scale; (the scale, the error of that, |vector|)."""
    most = np.float32(0.0)
    for d in range(len(vector)):
        most = max(most, abs(vector[d]))
    scale = float(most) / 127.0
    inverse = np.float32(1.0 / scale if scale > 0 else 0.0)
    rest, length = 0.0, 0.0
    for d in range(len(vector)):
        codes[d] = np.int8(np.rint(vector[d] * inverse))
        rest += (float(vector[d]) - codes[d] * scale) ** 2
        length += float(vector[d]) ** 2
    return scale, math.sqrt(rest), math.sqrt(length)


@njit(cache=True, nogil=True, fastmath={"reassoc", "nsz", "contract"})  # type: ignore[untyped-decorator]
def cosines(exact: Any, rows: Any, vector: Any, found: Any) -> None:
    """Set ``found`` (K,) to the products of these ``rows`` of ``exact`` (N, D) with ``vector`` (D,).

    Summed in float64 and rounded to float32's precision, so that a row's cosine is the same beside any others.
    """
    asked = vector.astype(np.float64)
    for k in range(len(rows)):
        if not 0 <= rows[k] < len(exact):
            raise IndexError("There is no such row among the vectors.")
        row, total = exact[rows[k]], 0.0
        for d in range(len(asked)):
            total += row[d] * asked[d]
        found[k] = np.float32(total)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def products(codes: Any, query: Any, scale: Any, own: float, found: Any) -> None:
    """Set ``found`` (N,) to the products of the rows with the query, times ``scale`` (N,) and ``own``.

    ``codes`` (blocks, D, rows of a block) and ``query`` (D,) are int8; sums are exact.
    """
    # Eight dimensions at a time, the last of them filled up with what counts nothing. (Numpy's ways to say this would
    # take seconds to compile.)
    dims, amounts = np.zeros(len(query) + 7, np.int64), np.zeros(len(query) + 7, np.int32)
    there = 0
    for dim in range(len(query)):
        if query[dim]:
            dims[there], amounts[there] = dim, query[dim]
            there += 1
    groups = (there + 7) // 8
    block = codes.shape[2]
    sums = np.empty(block, np.int32)
    for b in range((len(found) + block - 1) // block):
        first = b * block
        count = min(block, len(found) - first)
        for i in range(count):
            sums[i] = 0
        for g in range(groups):
            d, a = dims[8 * g :], amounts[8 * g :]
            a0, a1, a2, a3, a4, a5, a6, a7 = a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]
            c0, c1, c2, c3 = codes[b, d[0]], codes[b, d[1]], codes[b, d[2]], codes[b, d[3]]
            c4, c5, c6, c7 = codes[b, d[4]], codes[b, d[5]], codes[b, d[6]], codes[b, d[7]]
            for i in range(count):
                sums[i] += (
                    a0 * np.int32(c0[i]) + a1 * np.int32(c1[i]) + a2 * np.int32(c2[i]) + a3 * np.int32(c3[i])
                    + a4 * np.int32(c4[i]) + a5 * np.int32(c5[i]) + a6 * np.int32(c6[i]) + a7 * np.int32(c7[i])
                )  # fmt: skip
        for i in range(count):
            found[first + i] = sums[i] * scale[first + i] * own


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def keep(codes: Any, kept: Any, into: Any) -> None:
    """Copy the ``kept`` (K,) rows of ``codes`` to the first K of ``into``, both in blocks."""
    block, larger = codes.shape[2], into.shape[2]
    for first in range(0, len(kept), larger):
        rows = kept[first : first + larger]
        blocks, places = rows // block, rows % block
        for d in range(codes.shape[1]):
            for i in range(len(rows)):
                into[first // larger, d, i] = codes[blocks[i], d, places[i]]
