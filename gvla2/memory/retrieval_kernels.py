"""The compiled loops of ranking: every row's score S nearly, in one pass. They allocate nothing of size N.

:mod:`gvla2.memory.scoring` is what they must agree with; the few rows near the top are scored by it anew.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Arguments are arrays of one dimension (N,). Any: numba's decorator leaves no types behind.
_BLOCK = 32
USED_TABLE = 64
"""Usage bonuses up to this count come from a table: logarithms are what would take the time."""


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def add_differences(known: Any, asked: float, total: Any, shared: Any) -> None:
    """Add the relative differences to a number where it is known (not nan) to ``total``, and 1 to ``shared``."""
    for i in range(len(known)):
        value = known[i]
        if value == value:
            total[i] += abs(asked - value) / max(abs(asked), abs(value), 1e-9)
            shared[i] += 1


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def rule_out(known: Any, asked: float, most: float, fits: Any) -> None:
    """Set ``fits`` False where a number is known and differs relatively by more than ``most``."""
    for i in range(len(known)):
        value = known[i]
        if value == value and abs(asked - value) / max(abs(asked), abs(value), 1e-9) > most:
            fits[i] = False


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
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


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def near_scores(
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
    text: Any,  # bm25 weight, cosine weight, least coverage, cosine and relevance
    weights: Any,  # see Standing.numbers
    bonuses: Any,  # (types, outcomes)
    used: Any,  # (USED_TABLE,)
    constraint: int,
    scores: Any,  # (N,) out: S, -inf for what is not about the query or does not fit
) -> Any:
    """(rows about the query and not fitting, the row of largest relevance that is allowed or -1).

    Rows that cannot come among the best ``_BLOCK`` get the most that they could have, which is quicker to say.
    """
    elsewhere, best, best_row = 0, -1.0, -1
    heap = np.full(_BLOCK, -np.inf)
    most = max(weights[0], 0.0) + max(weights[3], 0.0) + (abs(weights[9]) if len(total) else 0.0)
    if min(weights[4], weights[6], weights[8], weights[2]) < 0:
        most = np.inf  # penalties that reward: nothing is known beforehand
    per_day, per_year = 1.0 / weights[1], 1.0 / 365.0
    for i in range(len(lexical)):
        scores[i] = -np.inf
        if len(allowed) and not allowed[i]:
            continue
        relevance = text[0] * lexical[i] + text[1] * max(cosine[i], 0.0)
        if relevance > best:
            best, best_row = relevance, i
        if (coverage[i] < text[2] and cosine[i] < text[3]) or relevance < text[4]:
            continue
        if len(fits) and not fits[i]:
            elsewhere += 1
            continue
        score = relevance + min(max(confidence[i], 0.0), 1.0) + bonuses[types[i], outcomes[i]]
        if score + most < heap[0]:
            scores[i] = score + most
            continue
        uses = max(usage[i], 0)
        use = used[uses] if uses < len(used) else min(math.log1p(uses) / weights[2], weights[3])
        if types[i] == constraint and ages[i] > weights[7] and uses == 0:
            stale = weights[6]
        else:
            stale = max(min(ages[i] * per_year, weights[8]) - use / 2, 0.0)
        score += max(weights[0] - min(ages[i] * per_day, weights[0]), 0.0) + use - stale
        score -= min(weights[4] * max(conflicts[i], 0), weights[5])
        if len(total) and shared[i]:
            score += weights[9] * (2 * math.exp(-total[i] / shared[i] / weights[10]) - 1)
        scores[i] = score
        if score > heap[0]:
            _push(heap, score)
    return elsewhere, best_row


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def edge(scores: Any, count: int) -> float:
    """The ``count``-th largest score, by a heap of that many; -inf where there are fewer that are finite."""
    heap = np.full(count, -np.inf)
    for value in scores:
        if value > heap[0]:
            _push(heap, value)
    return float(heap[0])
