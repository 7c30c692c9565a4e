"""The compiled loops over postings; numba keeps them between processes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Arguments are arrays of one dimension, as gvla2.memory.indexing.postings.Postings describes them. Any: numba's
# decorator leaves no types behind.


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def wanted(terms: Any, length: Any, room: Any, new_room: Any) -> Any:
    """How many new places the pool needs for one more posting of each of ``terms``.

    ``new_room`` (T,) zeros in, out: the room of the words that must move.
    """
    for term in terms:
        new_room[term] += 1
    extra = 0
    for term in terms:
        coming = new_room[term]
        if coming <= 0:
            continue  # seen already
        if length[term] + coming > room[term]:
            larger = max(2 * room[term], length[term] + coming)
            new_room[term] = -larger
            extra += larger
        else:
            new_room[term] = 0
    for term in terms:
        if new_room[term] < 0:
            new_room[term] = -new_room[term]
    return extra


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def append(
    terms: Any,
    rows: Any,
    counts: Any,
    new_room: Any,
    start: Any,
    length: Any,
    room: Any,
    pool_rows: Any,
    pool_counts: Any,
    used: int,
) -> int:
    """Move the words that need it to the pool's end, then write each posting; returns the pool's new end."""
    for i in range(len(terms)):
        term = terms[i]
        if new_room[term] > 0:
            for k in range(length[term]):
                pool_rows[used + k] = pool_rows[start[term] + k]
                pool_counts[used + k] = pool_counts[start[term] + k]
            start[term] = used
            room[term] = new_room[term]
            used += new_room[term]
            new_room[term] = 0
        place = start[term] + length[term]
        pool_rows[place] = rows[i]
        pool_counts[place] = counts[i]
        length[term] += 1
    return used


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def score(
    terms: Any,
    groups: Any,
    holders: Any,
    documents: Any,
    total: Any,
    start: Any,
    length: Any,
    pool_rows: Any,
    pool_counts: Any,
    sizes: Any,
    k1: float,
    b: float,
    found: Any,
    hits: Any,
) -> None:
    """Add each word's BM25 to ``found`` (N,) and 1 to ``hits`` (N,) of the rows that have it.

    Statistics are those of the ``groups`` (few numbers): ``holders`` (G, T), ``documents`` and ``total`` (G,).
    """
    living, words = 0, 0
    for group in groups:
        living += documents[group]
        words += total[group]
    if living == 0:
        return
    flat, by_size = k1 * (1 - b), k1 * b / max(words / living, 1e-9)
    for term in terms:
        having = 0
        for group in groups:
            having += holders[group, term]
        weight = math.log1p((living - having + 0.5) / (having + 0.5)) * (k1 + 1.0)
        for place in range(start[term], start[term] + length[term]):
            row = np.uint32(pool_rows[place])  # a sign would be looked at, which takes half of the time
            often = float(pool_counts[place])
            found[row] += weight * often / (often + flat + by_size * sizes[row])
            hits[row] += np.uint16(1)


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})  # type: ignore[untyped-decorator]
def shares(found: Any, hits: Any, order: Any, words: int, lexical: Any, coverage: Any) -> None:
    """Set ``lexical`` (K,) to BM25 divided by its largest value, and ``coverage`` (K,) to the share of the words.

    ``order`` (K,) are the rows meant, or (0,) for all of the (N,) that were found.
    """
    if len(order):
        for i in range(len(order)):
            lexical[i] = found[order[i]]
            coverage[i] = hits[order[i]] / words
    else:
        for i in range(len(found)):
            lexical[i] = found[i]
            coverage[i] = hits[i] / words
    best = 0.0
    for i in range(len(lexical)):
        best = max(best, lexical[i])
    if best > 0:
        best = 1.0 / best
        for i in range(len(lexical)):
            lexical[i] *= best


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def remap(
    new_row: Any,
    start: Any,
    length: Any,
    pool_rows: Any,
    pool_counts: Any,
    new_start: Any,
    new_length: Any,
    new_rows: Any,
    new_counts: Any,
) -> int:
    """Copy the pool with renumbered rows, leaving out those that go; returns how many postings are left."""
    used = 0
    for term in range(len(start)):
        new_start[term] = used
        for place in range(start[term], start[term] + length[term]):
            row = new_row[pool_rows[place]]
            if row >= 0:
                new_rows[used] = row
                new_counts[used] = pool_counts[place]
                used += 1
        new_length[term] = used - new_start[term]
    return used
