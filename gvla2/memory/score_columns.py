"""The terms of S for many records at once; :mod:`gvla2.memory.scoring` says what they mean, one record at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import OUTCOMES, TYPES, Candidates
from gvla2.memory.retrieval_kernels import USED_TABLE
from gvla2.memory.scoring import ScoreWeights, score_terms

CONSTRAINT = TYPES.index("failure_avoidance")


class Standing:
    """The terms of S that hang on no query: confidence, success, recency, usage, conflict, stale."""

    def __init__(self, weights: ScoreWeights) -> None:
        self._weights = weights
        self.bonuses = _bonuses(weights)  # (types, outcomes)
        counts = np.arange(USED_TABLE)
        self.used = np.minimum(np.log1p(counts) / weights.usage_divisor, weights.usage_most)
        self.numbers = np.array(
            [
                weights.recency, weights.recency_days, weights.usage_divisor, weights.usage_most,
                weights.conflict, weights.conflict_most, weights.stale_failure, weights.stale_days,
                weights.ageing, weights.applicability, weights.signature_scale,
            ]
        )  # fmt: skip
        """The weights in the order in which the compiled loop takes them."""

    def terms(self, candidates: Candidates, rows: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        """(K,) terms by name of these rows."""
        weights = self._weights
        ages, usage, types = candidates.ages[rows], candidates.usage[rows], candidates.types[rows]
        used = np.minimum(np.log1p(np.maximum(usage, 0)) / weights.usage_divisor, weights.usage_most)
        stale = np.maximum(np.minimum(ages / 365.0, weights.ageing) - used / 2, 0.0)
        unused = (types == CONSTRAINT) & (ages > weights.stale_days) & (usage <= 0)
        stale[unused] = weights.stale_failure
        conflicts = np.maximum(candidates.conflicts[rows], 0)
        recency = weights.recency - np.minimum(ages / weights.recency_days, weights.recency)
        return {
            "confidence": np.minimum(np.maximum(candidates.confidence[rows], 0.0), 1.0),
            "success": self.bonuses[types, candidates.outcomes[rows]],
            "recency": np.maximum(recency, 0.0),
            "usage": used,
            "conflict": -np.minimum(weights.conflict * conflicts, weights.conflict_most),
            "stale": -stale,
        }


def applicability(weights: ScoreWeights, distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,) the term of the scene's geometry; 0 where the distance is nan."""
    fit = weights.applicability * (2 * np.exp(-distances / weights.signature_scale) - 1)
    return np.where(np.isnan(distances), 0.0, fit)


def signature_distances(
    signature: Mapping[str, float], numbers: Callable[[str], NDArray[np.float64]], count: int
) -> NDArray[np.float64]:
    """(K,) mean relative difference, 0 to 2, of the numbers that a scene shares with each record; nan for none.

    ``numbers`` gives the (K,) numbers of the records by name, nan where absent.
    """
    names = [name for name in sorted(signature) if math.isfinite(signature[name])]
    if not names or not count:
        return np.full(count, np.nan)
    known = np.array([numbers(name) for name in names])  # (F, K)
    asked = np.array([[float(signature[name])] for name in names])
    there = known == known  # nan is not
    shared = there.sum(axis=0)
    total = np.where(there, relative_differences(asked, known), 0.0).sum(axis=0)
    return np.asarray(np.divide(total, shared, out=np.full(count, np.nan), where=shared > 0))


def relative_differences(
    asked: NDArray[np.float64] | float, known: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Differences divided by the larger of the two numbers, nan where ``known`` is; ``asked`` is finite."""
    return np.asarray(np.abs(asked - known) / np.maximum(np.maximum(np.abs(asked), np.abs(known)), 1e-9))


def _bonuses(weights: ScoreWeights) -> NDArray[np.float64]:
    """(types, outcomes) the success term, as the scalar rule has it."""
    return np.array(
        [
            [
                score_terms(
                    weights,
                    relevance=0,
                    confidence=0,
                    outcome=outcome,
                    type=type,
                    age=0,
                    usage=0,
                    conflicts=0,
                )["success"]
                for outcome in OUTCOMES
            ]
            for type in TYPES
        ]
    )
