"""What S hangs on that is known before any query: weights and thresholds, as the compiled loops take them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.memory.contracts import OUTCOMES, TYPES
from gvla2.memory.retrieval.kernels import USED_TABLE
from gvla2.memory.retrieval.options import HybridOptions
from gvla2.memory.retrieval.scoring import ScoreWeights, score_terms

CONSTRAINT = TYPES.index("failure_avoidance")
TERMS = ("r_text", "confidence", "success", "recency", "usage", "conflict", "stale", "applicability")
"""The terms of S, in the order in which they are added."""


class ScoreTables:
    """Tables of the terms of S; :mod:`gvla2.memory.retrieval.scoring` says what they mean."""

    def __init__(self, options: HybridOptions) -> None:
        weights = options.weights
        for name in ("recency_days", "usage_divisor", "signature_scale"):
            if getattr(weights, name) == 0:
                raise ConfigurationError(
                    f"The weight '{name}' of the retriever is 0, and S divides by it: give a positive one."
                )
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
        self.asked = np.array(
            [
                options.bm25_weight, options.cosine_weight, options.min_coverage, options.min_cosine,
                options.min_relevance,
            ]
        )  # fmt: skip


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
