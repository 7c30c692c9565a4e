"""Statistics of measured rows: intervals of success rates, paired tests and differences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

import numpy as np
from numpy.typing import NDArray

NORMAL_95 = 1.959963984540054
"""Two-sided 95 % quantile of the standard normal distribution."""
NORMAL_80 = 0.8416212335729143
"""80 % quantile of the standard normal distribution."""
FEWEST_DIFFERENT = 6
"""Pairs that all differ the same way, for an exact p < .05."""

Pair = tuple[bool, bool]
"""Success of one episode under the first condition and under the second."""


def wilson_interval(successes: float, trials: int) -> tuple[float, float]:
    """95 % Wilson score interval of a proportion, as shares in [0, 1].

    ``successes`` may be fractional: the mean of a trial that was repeated counts once. Raises ValueError unless
    0 <= successes <= trials and trials > 0.
    """
    if trials <= 0 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials is not a proportion.")
    share, spread = successes / trials, NORMAL_95**2 / trials
    half = NORMAL_95 * math.sqrt(share * (1 - share) / trials + spread / (4 * trials))
    low, high = ((share + spread / 2 + sign * half) / (1 + spread) for sign in (-1, 1))
    return max(0.0, low), min(1.0, high)


def mean_and_deviation(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and sample standard deviation (0 for a single value). Raises ValueError for no values."""
    return fmean(values), stdev(values) if len(values) > 1 else 0.0


@dataclass(frozen=True)
class Change:
    """A change with its 95 % interval; ``count`` is the number of pairs, ``least`` the least change that they show."""

    value: float
    low: float
    high: float
    count: int
    least: float = math.inf


def relative_change(before: Sequence[float], after: Sequence[float], *, draws: int = 2000) -> Change:
    """How much the mean changed, in per cent of the mean before: 100 (mean(after) / mean(before) - 1).

    ``before[i]`` and ``after[i]`` belong to the same object. The interval is the percentile bootstrap over pairs
    (Efron), so differences between objects do not blur the change; one pair gives an interval of zero width. The least
    change is what a paired t test finds (p < .05, power 80 %) if objects differ from one another as here. Raises
    ValueError for no pairs, unequal lengths, values that are not finite, or a mean of zero before.
    """
    from scipy.stats import bootstrap, t

    old, new = np.asarray(before, dtype=np.float64), np.asarray(after, dtype=np.float64)
    if old.shape != new.shape or old.ndim != 1 or len(old) == 0:
        raise ValueError(f"Pairs are needed, got {old.shape} values before and {new.shape} after.")
    if not np.isfinite([old, new]).all() or old.mean() == 0:
        raise ValueError("Values must be finite and the mean before must not be zero.")

    def change(one: NDArray[np.float64], two: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
        return np.asarray(100 * (two.mean(axis=axis) / one.mean(axis=axis) - 1))

    value = float(change(old, new))
    if len(old) == 1:
        return Change(value, value, value, 1)
    found = bootstrap(
        (old, new), change, paired=True, vectorized=True, n_resamples=draws, method="percentile", rng=0
    )
    low, high = found.confidence_interval
    spread = (new - old).std(ddof=1) / math.sqrt(len(old)) / abs(old.mean())
    least = 100 * spread * (t.ppf(0.975, len(old) - 1) + t.ppf(0.8, len(old) - 1))
    return Change(value, float(low), float(high), len(old), float(least))


def won_and_lost(pairs: Sequence[Pair]) -> tuple[int, int]:
    """Episodes that succeed only under the second condition, and only under the first."""
    return sum(b and not a for a, b in pairs), sum(a and not b for a, b in pairs)


def exact_mcnemar(pairs: Sequence[Pair]) -> float:
    """Two-sided exact p of McNemar's test: does the second condition win as often as it loses?

    1 where no episode differs.
    """
    won, lost = won_and_lost(pairs)
    tail = sum(math.comb(won + lost, k) for k in range(min(won, lost) + 1))
    return float(min(1.0, 2 * tail / 2 ** (won + lost)))


def detectable_difference(pairs: Sequence[Pair]) -> float:
    """The least difference, in points, that McNemar's test finds in this number of pairs (p < .05, power 80 %) if the
    share that differs is as here (Connor, 1987, simplified).

    It is at least that of the six pairs that an exact p < .05 needs; infinite for fewer than six.
    """
    if len(pairs) < FEWEST_DIFFERENT:
        return math.inf
    differ = sum(won_and_lost(pairs)) / len(pairs)
    power = (NORMAL_95 + NORMAL_80) * math.sqrt(differ / len(pairs))
    return 100 * max(power, FEWEST_DIFFERENT / len(pairs))


def holm(values: Mapping[str, float]) -> dict[str, float]:
    """P values adjusted for their number, by Holm's step-down."""
    adjusted: dict[str, float] = {}
    least = 0.0
    for rank, name in enumerate(sorted(values, key=lambda name: values[name])):
        least = max(least, min(1.0, (len(values) - rank) * values[name]))
        adjusted[name] = least
    return adjusted


def pooled_difference(by_task: Mapping[str, Sequence[Pair]], *, draws: int = 4000, seed: int = 0) -> Change:
    """How much the second condition adds to the success rate, in percentage points, averaged over tasks.

    The interval is the percentile bootstrap in two stages: tasks are drawn, then episodes within each, since episodes
    of one task are alike. Raises ValueError for no pairs.
    """
    gains = [np.array([int(b) - int(a) for a, b in pairs]) for pairs in by_task.values() if len(pairs)]
    if not gains:
        raise ValueError("No pairs: no difference.")
    rng = np.random.default_rng(seed)
    drawn = [
        np.mean([rng.choice(gains[task], len(gains[task])).mean() for task in tasks])
        for tasks in rng.integers(0, len(gains), (draws, len(gains)))
    ]
    low, high = np.percentile(100 * np.array(drawn), [2.5, 97.5])
    points = 100 * float(np.mean([gain.mean() for gain in gains]))
    return Change(points, float(low), float(high), sum(map(len, gains)))
