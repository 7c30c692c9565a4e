"""Intervals: of success rates, and of paired changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

NORMAL_95 = 1.959963984540054
"""Two-sided 95 % quantile of the standard normal distribution."""


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


@dataclass(frozen=True)
class Change:
    """A relative change of means, in per cent, with its bootstrap interval; ``count`` is the number of pairs."""

    percent: float
    low: float
    high: float
    count: int


def paired_change(
    before: Sequence[float], after: Sequence[float], *, level: float = 0.95, draws: int = 2000, seed: int = 0
) -> Change:
    """How much the mean changed, in per cent of the mean before: 100 (mean(after) / mean(before) - 1).

    ``before[i]`` and ``after[i]`` belong to the same object. The interval is the percentile bootstrap over pairs
    (Efron), so differences between objects do not blur the change; one pair gives an interval of zero width. Raises
    ValueError for no pairs, unequal lengths, values that are not finite, or a mean of zero before.
    """
    old, new = np.asarray(before, dtype=np.float64), np.asarray(after, dtype=np.float64)
    if old.shape != new.shape or old.ndim != 1 or len(old) == 0:
        raise ValueError(f"Pairs are needed, got {old.shape} values before and {new.shape} after.")
    if not (np.isfinite(old).all() and np.isfinite(new).all()) or old.mean() == 0:
        raise ValueError("Values must be finite and the mean before must not be zero.")
    picks = np.random.default_rng(seed).integers(0, len(old), size=(draws, len(old)))
    # A draw whose old values cancel out has no relative change; with positive measures there is none.
    below = old[picks].mean(axis=1)
    changes = 100 * (new[picks].mean(axis=1)[below != 0] / below[below != 0] - 1)
    tail = 50 * (1 - level)
    low, high = np.percentile(changes, [tail, 100 - tail])
    return Change(float(100 * (new.mean() / old.mean() - 1)), float(low), float(high), len(old))


def mean_and_deviation(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and sample standard deviation (0 for a single value). Raises ValueError for no values."""
    if len(values) == 0:
        raise ValueError("No values: no mean.")
    array = np.asarray(values, dtype=np.float64)
    return float(array.mean()), float(array.std(ddof=1)) if len(array) > 1 else 0.0
