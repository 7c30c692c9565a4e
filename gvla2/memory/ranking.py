"""The best rows in exact order, where a score is known for all of them only nearly."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.retrieval_kernels import edge


def best_first(
    near: NDArray[np.float64],
    slack: float,
    exact: Callable[[NDArray[np.int64]], NDArray[np.float64]],
    ids: Sequence[str],
    *,
    block: int = 32,
) -> Iterator[tuple[int, float]]:
    """(row, exact score) of all rows, best first; equal scores by id.

    No exact score may be larger than its ``near`` one (N,) by more than ``slack``. ``exact`` gives the (K,) exact
    ones of some rows, -inf for those that don't count; so does ``near``. It is asked for no more of them than the
    order of what is taken needs.
    """
    given: set[int] = set()
    while True:
        # Whatever is not chosen scores less than ``certain``.
        least = edge(near, block) if block < len(near) else -np.inf
        chosen = np.flatnonzero(near >= least) if least > -np.inf else np.flatnonzero(near > -np.inf)
        certain = least + slack
        scores = exact(chosen)
        kept = np.flatnonzero((scores >= certain) & (scores > -np.inf))
        kept = kept[np.argsort(-scores[kept], kind="stable")]
        for row, score in _ties_by_id(chosen[kept].tolist(), scores[kept].tolist(), ids):
            if row not in given:
                given.add(row)
                yield row, score
        if least == -np.inf:
            return
        block *= 4


def best(
    near: NDArray[np.float64],
    slack: float,
    exact: Callable[[NDArray[np.int64]], NDArray[np.float64]],
    ids: Sequence[str],
    count: int,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """((K,) rows, (K,) exact scores) of the first ``count`` of :func:`best_first`, quicker where none are equal."""
    block = max(32, 2 * count)
    least = edge(near, block) if block < len(near) else -np.inf
    if count > 0 and least > -np.inf:
        chosen = np.flatnonzero(near >= least)
        scores = exact(chosen)
        order = np.argsort(-scores, kind="stable")[: count + 1]
        top = scores[order]
        if top[count - 1] >= least + slack and (top[:-1] != top[1:]).all():
            return chosen[order[:count]], top[:count]
    found = list(islice(best_first(near, slack, exact, ids, block=block), max(count, 0)))
    return np.array([row for row, _ in found], np.int64), np.array([score for _, score in found])


def _ties_by_id(
    rows: Sequence[int], scores: Sequence[float], ids: Sequence[str]
) -> Iterator[tuple[int, float]]:
    """Equal scores are rare, so ids are looked up for those alone."""
    first = 0
    while first < len(scores):
        last = first + 1
        while last < len(scores) and scores[last] == scores[first]:
            last += 1
        tied = rows[first:last]
        for row in tied if last == first + 1 else sorted(tied, key=lambda row: ids[row]):
            yield row, scores[first]
        first = last
