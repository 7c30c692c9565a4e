"""How well a score in [0, 1] separates successes from failures: ranking and calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata


def auc(scores: Sequence[float], truths: Sequence[bool]) -> float | None:
    """The probability that a success scores higher than a failure, ties counting half; None without one of each."""
    values, won = np.asarray(scores, float), np.asarray(truths, bool)
    good, bad = int(won.sum()), int((~won).sum())
    if not good or not bad:
        return None
    ranks = rankdata(values)
    return float((ranks[won].sum() - good * (good + 1) / 2) / (good * bad))


def auc_interval(
    scores: Sequence[float],
    truths: Sequence[bool],
    groups: Sequence[str],
    *,
    draws: int = 1000,
    seed: int = 0,
) -> tuple[float, float] | None:
    """A 95 % bootstrap interval that draws whole groups: runs of one task are not independent."""
    values, won = np.asarray(scores, float), np.asarray(truths, bool)
    names, members = np.unique(np.asarray(groups), return_inverse=True)
    places: list[NDArray[np.intp]] = [np.flatnonzero(members == i) for i in range(len(names))]
    generator = np.random.default_rng(seed)
    found: list[float] = []
    for _ in range(draws):
        chosen = np.concatenate([places[i] for i in generator.integers(len(names), size=len(names))])
        value = auc(values[chosen].tolist(), won[chosen].tolist())
        if value is not None:
            found.append(value)
    if len(found) < draws // 2:
        return None
    low, high = np.percentile(found, [2.5, 97.5])
    return float(low), float(high)


def calibration_error(scores: Sequence[float], truths: Sequence[bool], bins: int = 10) -> float | None:
    """The expected calibration error: the mean distance of a bin's score from its share of successes."""
    values, won = np.asarray(scores, float), np.asarray(truths, float)
    if not len(values):
        return None
    at = np.clip((values * bins).astype(int), 0, bins - 1)
    distance = [
        abs(values[at == i].mean() - won[at == i].mean()) * (at == i).mean()
        for i in range(bins)
        if (at == i).any()
    ]
    return float(sum(distance))
