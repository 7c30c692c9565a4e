"""The best rows in exact order, where a score is known for all of them only nearly."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.retrieval.kernels import falling

Nearly = Callable[[int], tuple[NDArray[np.int64], float]]
"""Given a count, ((K,) rows in rising order, the least of their near scores): at least that many of the largest, so
that all other rows have smaller ones; or all rows that count, and -inf.
"""
Exactly = Callable[[NDArray[np.int64]], NDArray[np.float64]]
"""(K,) exact scores of some rows, -inf for those that don't count."""


def blocks_in_order(
    near: Nearly, slack: float, exact: Exactly, ids: Sequence[str], *, block: int = 32
) -> Iterator[tuple[list[int], list[float]]]:
    """(rows, exact scores) of all rows, best first, some at a time; equal scores by id.

    No exact score may be larger than its near one by more than ``slack``. ``exact`` is asked for no more of them than
    the order of what is taken needs.
    """
    given: set[int] = set()
    while True:
        chosen, least = near(block)
        # Whatever is not chosen scores less than the least of them, and the slack.
        scores = exact(chosen)
        order = np.argsort(-scores, kind="stable")
        settled, scores, tied = falling(order, chosen, scores, least + slack)
        found, best = settled.tolist(), scores.tolist()
        if tied:
            found = _ties_by_id(found, best, ids)
        if given:
            new = [i for i, row in enumerate(found) if row not in given]
            found, best = [found[i] for i in new], [best[i] for i in new]
        if found:
            given.update(found)
            yield found, best
        if least == -np.inf:
            return
        block *= 4


def best_first(
    near: Nearly, slack: float, exact: Exactly, ids: Sequence[str], *, block: int = 32
) -> Iterator[tuple[int, float]]:
    """(row, exact score) of all rows, one by one in the order of :func:`blocks_in_order`."""
    for rows, scores in blocks_in_order(near, slack, exact, ids, block=block):
        yield from zip(rows, scores, strict=True)


def best(
    near: Nearly, slack: float, exact: Exactly, ids: Sequence[str], count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """((K,) rows, (K,) exact scores) of the first ``count`` of :func:`best_first`, quicker where none are equal."""
    block = max(32, 2 * count)
    if count > 0:
        chosen, least = near(block)
        if least > -np.inf:
            scores = exact(chosen)
            order = np.argsort(-scores, kind="stable")[: count + 1]
            top = scores[order]
            if top[count - 1] >= least + slack and (top[:-1] != top[1:]).all():
                return chosen[order[:count]], top[:count]
    found = list(islice(best_first(near, slack, exact, ids, block=block), max(count, 0)))
    return np.array([row for row, _ in found], np.int64), np.array([score for _, score in found])


def _ties_by_id(rows: list[int], scores: list[float], ids: Sequence[str]) -> list[int]:
    """Rows of equal scores in the order of their ids."""
    first = 0
    while first < len(scores):
        last = first + 1
        while last < len(scores) and scores[last] == scores[first]:
            last += 1
        if last > first + 1:
            rows[first:last] = sorted(rows[first:last], key=lambda row: ids[row])
        first = last
    return rows
