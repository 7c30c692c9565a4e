"""The compiled loops of ranking: every row's score S nearly, and that of a few rows exactly.

:mod:`gvla2.memory.retrieval.scoring` is what they must agree with.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Arguments are arrays of one dimension (N,). Any: numba's decorator leaves no types behind.
_BLOCK = 512
USED_TABLE = 64
"""Usage bonuses up to this count come from a table: logarithms are what would take the time."""


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def days_since(times: Any, now: float, days: Any) -> None:
    """Set ``days`` (N,) to what went by since ``times``, in seconds; never negative."""
    for i in range(len(times)):
        days[i] = max(now - times[i], 0.0) / 86400.0


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def add_differences(known: Any, asked: float, total: Any, shared: Any, most: float, fits: Any) -> None:
    """Add the relative differences to a number where it is known (not nan) to ``total``, and 1 to ``shared``.

    ``fits`` turns False where one is more than ``most``; (0,) where nobody asks.
    """
    least = max(abs(asked), 1e-9)
    for i in range(len(known)):
        value = known[i]
        difference = abs(asked - value) / max(abs(value), least)
        there = value == value
        total[i] += difference if there else 0.0
        shared[i] += 1.0 if there else 0.0
    for i in range(len(fits)):
        # Never true of nan.
        fits[i] &= not abs(asked - known[i]) / max(abs(known[i]), least) > most


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _push(heap: Any, value: float) -> None:
    """Replace the least of a heap by a larger value."""
    place = 0
    while True:
        child = 2 * place + 1
        if child >= len(heap):
            break
        if child + 1 < len(heap) and heap[child + 1] < heap[child]:
            child += 1
        if heap[child] >= value:
            break
        heap[place] = heap[child]
        place = child
    heap[place] = value


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _standing(
    age: float, usage: int, conflicts: int, constraint: bool, weights: Any, used: Any
) -> tuple[float, float, float, float]:
    """The terms recency, usage, conflict and stale of a row."""
    uses = max(usage, 0)
    use = used[uses] if uses < len(used) else min(math.log1p(uses) / weights[2], weights[3])
    recency = max(weights[0] - min(age / weights[1], weights[0]), 0.0)
    if constraint and age > weights[7] and uses == 0:
        stale = weights[6]
    else:
        stale = max(min(age / 365.0, weights[8]) - use / 2, 0.0)
    return recency, use, -min(weights[4] * max(conflicts, 0), weights[5]), -stale


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _fit(total: float, shared: float, weights: Any) -> float:
    """The term applicability of a row, 0 where it shares no number with the task."""
    return weights[9] * (2 * math.exp(-(total / shared) / weights[10]) - 1) if shared else 0.0


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _fit_at_most(total: Any, shared: Any, weights: Any, gains: Any) -> None:
    """Set ``gains`` to at least :func:`_fit` of each row, by exp(-x) <= 1 / (1 + x + x^2 / 2), which is quicker."""
    if weights[9] < 0 or weights[10] < 0:
        gains[:] = abs(weights[9])
        return
    scale = 1.0 / weights[10]
    for k in range(len(total)):
        x = total[k] / shared[k] * scale
        gains[k] = weights[9] * (2.0 / (1.0 + x + 0.5 * x * x) - 1.0) if shared[k] > 0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def near_best(
    lexical: Any,
    coverage: Any,
    cosine: Any,
    confidence: Any,
    ages: Any,
    usage: Any,
    conflicts: Any,
    types: Any,
    outcomes: Any,
    allowed: Any,  # (N,) or (0,) for all
    fits: Any,  # the same
    total: Any,  # (N,) or (0,): relative differences of the signatures
    shared: Any,
    asked: Any,  # see ScoreTables.asked
    off: float,  # how far the cosines may be off: nobody who might pass is left out here
    weights: Any,  # see ScoreTables.numbers
    bonuses: Any,  # (types, outcomes)
    used: Any,  # (USED_TABLE,)
    constraint: int,
    count: int,
) -> Any:
    """((K,) rows, their least score): the rows whose near score S is among the ``count`` largest, and equal ones.

    All rows that count, and -inf, where there are fewer: those that are about the query, allowed and fitting.
    """
    per_day = 1.0 / weights[1]
    # Uses in the most that they may gain: the last place stands for that many and more.
    gain = used.copy()
    gain[-1] = max(gain[-1], weights[3])
    # Penalties that reward: nothing is known beforehand.
    rest = np.inf if min(weights[2], weights[4], weights[6], weights[8], weights[10]) < 0 else 1e-9
    rows, scores, found = np.empty(len(lexical), np.int64), np.empty(len(lexical)), 0
    heap, sums, gains = np.full(count, -np.inf), np.empty(_BLOCK), np.zeros(_BLOCK)
    slack, bar = asked[1] * off + 1e-9, -1e300
    along = asked[3] - off if asked[3] > 0 else -np.inf  # negative cosines count as 0
    for first in range(0, len(lexical), _BLOCK):
        # What is quickly said of all rows, without a branch; from slices, whose places have no sign to look at.
        part = slice(first, first + _BLOCK)
        words, share, near, sure, old = (
            lexical[part],
            coverage[part],
            cosine[part],
            confidence[part],
            ages[part],
        )
        for k in range(len(words)):
            relevance = asked[0] * words[k] + asked[1] * max(near[k], 0.0)
            about = ((share[k] >= asked[2]) | (near[k] >= along)) & (relevance >= asked[4] - slack)
            fresh = max(weights[0] - min(old[k] * per_day, weights[0]), 0.0)
            sums[k] = relevance + min(max(sure[k], 0.0), 1.0) + fresh if about else -np.inf
        if len(total):
            _fit_at_most(total[part], shared[part], weights, gains)
        kinds, verdicts, often = types[part], outcomes[part], usage[part]
        for k in range(len(words)):
            sums[k] += bonuses[np.uint8(kinds[k]), np.uint8(verdicts[k])]
            most = sums[k] + gains[k] + gain[np.uint64(min(max(often[k], 0), len(gain) - 1))] + rest
            # Most rows cannot come among the best, whatever else is true of them.
            if not most >= bar:
                continue
            i, score = first + k, sums[k]
            if (len(allowed) and not allowed[i]) or (len(fits) and not fits[i]) or score == -np.inf:
                continue
            terms = _standing(ages[i], usage[i], conflicts[i], types[i] == constraint, weights, used)
            score += terms[1] + terms[2] + terms[3]
            if len(total):
                score += _fit(total[i], shared[i], weights)
            if score >= heap[0]:
                rows[found], scores[found] = i, score
                found += 1
            if score > heap[0]:
                _push(heap, score)
                bar = max(heap[0], -1e300)
    best = 0
    for k in range(found):
        if scores[k] >= heap[0]:
            rows[best] = rows[k]
            best += 1
    return rows[:best], heap[0]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def exact_terms(
    rows: Any,  # (K,)
    cosines: Any,  # (K,) exact
    lexical: Any,
    coverage: Any,
    confidence: Any,
    ages: Any,
    usage: Any,
    conflicts: Any,
    types: Any,
    outcomes: Any,
    total: Any,
    shared: Any,
    asked: Any,
    weights: Any,
    bonuses: Any,
    used: Any,
    constraint: int,
) -> Any:
    """((K, 8) the terms of S in the order of TERMS, (K,) S, -inf for rows that are not about the query)."""
    terms, scores = np.empty((len(rows), 8)), np.empty(len(rows))
    for k in range(len(rows)):
        i = rows[k]
        cosine = min(max(cosines[k], 0.0), 1.0)
        relevance = asked[0] * lexical[i] + asked[1] * cosine
        terms[k, 0] = relevance
        terms[k, 1] = min(max(confidence[i], 0.0), 1.0)
        terms[k, 2] = bonuses[types[i], outcomes[i]]
        terms[k, 3], terms[k, 4], terms[k, 5], terms[k, 6] = _standing(
            ages[i], usage[i], conflicts[i], types[i] == constraint, weights, used
        )
        terms[k, 7] = _fit(total[i], shared[i], weights) if len(total) else 0.0
        score = 0.0
        for term in range(8):
            score += terms[k, term]
        about = (coverage[i] >= asked[2] or cosine >= asked[3]) and relevance >= asked[4]
        scores[k] = score if about else -np.inf
    return terms, scores


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def largest(values: Any, count: int) -> Any:
    """((K,) places, their least value): where the ``count`` largest values are, and equal ones; all places, and -inf,
    where there are fewer. Values of -inf don't count.
    """
    heap = np.full(count, -np.inf)
    places, found = np.empty(len(values), np.int64), 0
    for i in range(len(values)):
        if values[i] >= heap[0] and values[i] > -np.inf:
            places[found] = i
            found += 1
            if values[i] > heap[0]:
                _push(heap, values[i])
    best = 0
    for k in range(found):
        if values[places[k]] >= heap[0]:
            places[best] = places[k]
            best += 1
    return places[:best], heap[0]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def falling(order: Any, rows: Any, scores: Any, certain: float) -> Any:
    """((K,) rows, (K,) scores, whether two are equal): those of at least ``certain``, and above -inf, best first.

    ``order`` are the places of ``rows`` and ``scores``, best first.
    """
    sorted_rows, sorted_scores = np.empty(len(order), np.int64), np.empty(len(order))
    settled, tied = 0, False
    for k in order:
        if not (scores[k] >= certain and scores[k] > -np.inf):
            break
        tied |= settled > 0 and scores[k] == sorted_scores[settled - 1]
        sorted_rows[settled], sorted_scores[settled] = rows[k], scores[k]
        settled += 1
    return sorted_rows[:settled], sorted_scores[:settled], tied
