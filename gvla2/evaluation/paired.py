"""Paired comparisons of successes: the same episodes under two conditions, task by task and pooled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Pair = tuple[bool, bool]
"""Success of one episode under the first condition and under the second."""


def exact_mcnemar(pairs: Sequence[Pair]) -> float:
    """Two-sided exact p of McNemar's test: does the second condition win as many episodes as it loses?

    1 where no episode differs.
    """
    from scipy.stats import binomtest

    won, lost = won_and_lost(pairs)
    return float(binomtest(won, won + lost, 0.5).pvalue) if won + lost else 1.0


def won_and_lost(pairs: Sequence[Pair]) -> tuple[int, int]:
    """Episodes that succeed only under the second condition, and only under the first."""
    return sum(b and not a for a, b in pairs), sum(a and not b for a, b in pairs)


def holm(values: Mapping[str, float]) -> dict[str, float]:
    """P values adjusted for their number, by Holm's step-down."""
    order = sorted(values, key=lambda name: values[name])
    adjusted: dict[str, float] = {}
    least = 0.0
    for rank, name in enumerate(order):
        least = max(least, min(1.0, (len(order) - rank) * values[name]))
        adjusted[name] = least
    return adjusted


@dataclass(frozen=True)
class Difference:
    """A mean difference of success rates over tasks, in percentage points, with its interval; ``pairs`` episodes."""

    points: float
    low: float
    high: float
    tasks: int
    pairs: int


def pooled_difference(
    by_task: Mapping[str, Sequence[Pair]], *, level: float = 0.95, draws: int = 4000, seed: int = 0
) -> Difference:
    """How much the second condition adds to the success rate, averaged over tasks.

    The interval is the percentile bootstrap in two stages: tasks are drawn, then episodes within each, since episodes
    of one task are alike. Raises ValueError for no pairs.
    """
    gains = [np.array([int(b) - int(a) for a, b in pairs]) for pairs in by_task.values() if len(pairs)]
    if not gains:
        raise ValueError("No pairs: no difference.")
    rng = np.random.default_rng(seed)
    sums, sizes = np.empty((2, draws, len(gains)))
    for draw in range(draws):
        for place, task in enumerate(rng.integers(0, len(gains), len(gains)).tolist()):
            size = sizes[draw, place] = len(gains[task])
            sums[draw, place] = gains[task][rng.integers(0, size, size)].sum()
    tail = 50 * (1 - level)
    low, high = np.percentile(100 * (sums / sizes).mean(axis=1), [tail, 100 - tail])
    points = 100 * float(np.mean([gain.mean() for gain in gains]))
    return Difference(points, float(low), float(high), len(gains), sum(map(len, gains)))
