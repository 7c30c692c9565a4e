"""The compiled loops over postings; numba keeps them between processes."""

from __future__ import annotations

from typing import Any

from numba import njit

# Arguments are arrays of one dimension, as :class:`gvla2.memory.postings.Postings` describes them. Any: numba's
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
    idf: Any,
    start: Any,
    length: Any,
    pool_rows: Any,
    pool_counts: Any,
    sizes: Any,
    k1: float,
    flat: float,
    by_size: float,
    found: Any,
    hits: Any,
) -> None:
    """Add each word's BM25 to ``found`` (N,) and 1 to ``hits`` (N,) of the rows that have it."""
    for i in range(len(terms)):
        first = start[terms[i]]
        weight = idf[i] * (k1 + 1.0)
        for place in range(first, first + length[terms[i]]):
            row = pool_rows[place]
            often = float(pool_counts[place])
            found[row] += weight * often / (often + flat + by_size * sizes[row])
            hits[row] += 1


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
