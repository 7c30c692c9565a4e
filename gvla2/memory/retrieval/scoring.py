"""How much a record deserves to be recalled: S of the paper, term by term, for many records at once.

S(q, X, m) = r_text + kappa + b_success + b_recency + b_usage - p_conflict - p_stale, plus our own terms: the geometric
applicability of robot memories, and whether a program's roles can be filled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import OUTCOMES, TYPES
from gvla2.memory.indexing.candidates import Candidates
from gvla2.memory.meaning.terms import terms
from gvla2.memory.retrieval.options import ScoreWeights

Array = NDArray[np.float64]
_AVOIDANCE = TYPES.index("failure_avoidance")
_FAIL = OUTCOMES.index("verified_fail")


def score_terms(
    weights: ScoreWeights,
    candidates: Candidates,
    rows: NDArray[np.intp],
    *,
    relevance: Array,
    distance: Array,
    filled: Array,
) -> dict[str, Array]:
    """The terms of S by name, each (K,) for the (K,) ``rows``; penalties are negative, so that S is their sum.

    ``relevance`` (K,) is r_text in [0, 1]; ``distance`` (K,) of the scenes by :func:`scene_distance`, nan if not
    applicable; ``filled`` (K,) the share of a program's roles that can be filled, nan without a program.
    """
    ages, usage, outcomes = candidates.ages[rows], candidates.usage[rows], candidates.outcomes[rows]
    # In the order of OUTCOMES.
    bonus = np.array([weights.verified, weights.failed, weights.uncertain, weights.unjudged])
    avoidance = candidates.types[rows] == _AVOIDANCE
    used = np.minimum(np.log1p(np.maximum(usage, 0)) / weights.usage_divisor, weights.usage_most)
    forgotten = avoidance & (ages > weights.stale_days) & (usage <= 0)
    ageing = np.maximum(np.minimum(ages / 365.0, weights.ageing) - used / 2, 0.0)
    fit = 2 * np.exp(-distance / weights.signature_scale) - 1
    return {
        "r_text": relevance,
        "confidence": np.clip(candidates.confidence[rows], 0.0, 1.0),
        "success": np.where(avoidance & (outcomes == _FAIL), weights.verified, bonus[outcomes]),
        "recency": np.maximum(weights.recency - ages / weights.recency_days, 0.0),
        "usage": used,
        "conflict": -np.minimum(weights.conflict * candidates.conflicts[rows], weights.conflict_most),
        "stale": -np.where(forgotten, weights.stale_failure, ageing),
        "applicability": np.where(np.isnan(fit), 0.0, weights.applicability * fit),
        "program": np.where(np.isnan(filled), 0.0, weights.program * (2 * filled - 1)),
    }


def scene_distance(signature: Mapping[str, float], candidates: Candidates, rows: NDArray[np.intp]) -> Array:
    """(K,) mean relative difference, 0 (alike) to 2, of the numbers that both scenes have; nan for none."""
    total, shared = np.zeros(len(rows)), np.zeros(len(rows))
    for name, asked in signature.items():
        if math.isfinite(asked):
            difference = relative_difference(candidates.numbers(name)[rows], float(asked))
            known = ~np.isnan(difference)
            total[known] += difference[known]
            shared += known
    return np.where(shared > 0, total / np.maximum(shared, 1.0), math.nan)


def relative_difference(known: Array, asked: float) -> Array:
    """(N,) differences as a share of the larger number, nan if unknown."""
    return np.asarray(np.abs(known - asked) / np.maximum(np.maximum(np.abs(known), abs(asked)), 1e-9))


def share_filled(effect: Mapping[str, Any] | None, things: Sequence[str]) -> float:
    """How well the things can fill the program's roles, each thing one of them: 0 (no role) to 1 (every role in full).

    A role is filled by the share of its words that the thing has: a mug is not a cup, but both may be cylinders. The
    best pairs are taken first. nan without a program or roles, or if the things are unknown.
    """
    roles = (effect or {}).get("roles")
    if (effect or {}).get("kind") != "program" or not isinstance(roles, Mapping) or not (roles and things):
        return math.nan
    wanted, offered = [terms(str(role)) for role in roles.values()], [terms(thing) for thing in things]
    pairs = [
        (len(need & have) / len(need) if need else 1.0, i, j)
        for i, need in enumerate(wanted)
        for j, have in enumerate(offered)
    ]
    total, done, used = 0.0, set[int](), set[int]()
    for share, i, j in sorted(pairs, key=lambda pair: (-pair[0], pair[1:])):
        if i not in done and j not in used:
            total += share
            done.add(i)
            used.add(j)
    return total / len(wanted)
