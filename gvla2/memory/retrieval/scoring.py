"""How much a record deserves to be recalled: S of the paper, term by term.

S(q, X, m) = r_text + kappa + b_success + b_recency + b_usage - p_conflict - p_stale, and the geometric
applicability of robot memories. Pure arithmetic, without numerical libraries, so that configurations may hold
the weights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gvla2.memory.contracts import Outcome, RecordType


@dataclass
class ScoreWeights:
    """The constants of S, as the paper's authors released them; ``applicability`` is ours.

    Bonuses by the record's outcome: ``verified`` also holds for a constraint that a verified failure supports (the
    released rule counted every failure against its own lesson, which no constraint then survived); ``failed`` for
    anything else that failed; ``unjudged`` where the verifier was unavailable. ``recency`` is lost at one unit in
    ``recency_days``. ``stale_days`` without use make a failure stale; other records lose up to ``ageing`` over a
    year. ``applicability`` is gained in the very scene that a record comes from, and lost in a quite different one;
    ``signature_scale`` is the relative difference of a scene's numbers at which 1/e of the fit is left.
    """

    verified: float = 0.30
    unjudged: float = 0.05
    uncertain: float = -0.25
    failed: float = -0.10
    recency: float = 0.25
    recency_days: float = 90.0
    usage_divisor: float = 8.0
    usage_most: float = 0.20
    conflict: float = 0.15
    conflict_most: float = 0.45
    stale_failure: float = 0.25
    stale_days: float = 14.0
    ageing: float = 0.20
    applicability: float = 0.25
    signature_scale: float = 0.5


def score_terms(
    weights: ScoreWeights,
    *,
    relevance: float,
    confidence: float,
    outcome: Outcome,
    type: RecordType,
    age: float,
    usage: int,
    conflicts: int,
    distance: float | None = None,
) -> dict[str, float]:
    """The terms of S by name; penalties are negative, so that S is their sum.

    ``relevance`` r_text in [0, 1]; ``age`` in days since the last update; ``usage`` credited uses; ``conflicts``
    how many records contradict it; ``distance`` by :func:`signature_distance`, None where it does not apply.
    """
    days = max(age, 0.0)
    used = min(math.log1p(max(usage, 0)) / weights.usage_divisor, weights.usage_most)
    if type == "failure_avoidance" and days > weights.stale_days and usage <= 0:
        stale = weights.stale_failure
    else:
        stale = max(0.0, min(days / 365.0, weights.ageing) - used / 2)
    return {
        "r_text": relevance,
        "confidence": min(max(confidence, 0.0), 1.0),
        "success": _success(weights, outcome, type),
        "recency": max(0.0, weights.recency - min(days / weights.recency_days, weights.recency)),
        "usage": used,
        "conflict": -min(weights.conflict * max(conflicts, 0), weights.conflict_most),
        "stale": -stale,
        "applicability": 0.0
        if distance is None
        else weights.applicability * (2 * math.exp(-distance / weights.signature_scale) - 1),
    }


def _success(weights: ScoreWeights, outcome: Outcome, type: RecordType) -> float:
    if outcome == "verified_success" or (outcome == "verified_fail" and type == "failure_avoidance"):
        return weights.verified
    return {
        "verified_fail": weights.failed,
        "uncertain": weights.uncertain,
        "unavailable": weights.unjudged,
    }[outcome]


def signature_distance(first: Mapping[str, float], second: Mapping[str, float]) -> float | None:
    """Mean relative difference, 0 (alike) to 2, of the numbers that both scenes have; None when they share none."""
    shared = [
        (float(first[name]), float(second[name]))
        for name in sorted(first.keys() & second.keys())
        if math.isfinite(first[name]) and math.isfinite(second[name])
    ]
    if not shared:
        return None
    return sum(abs(a - b) / max(abs(a), abs(b), 1e-9) for a, b in shared) / len(shared)
