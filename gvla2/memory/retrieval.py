"""The retrievers of a bank: by the score S of the paper, with abstention, and by similarity alone.

S(q, X, m) = r_text + kappa + b_success + b_recency + b_usage - p_conflict - p_stale.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.candidates import Array, Candidates, HeldRecord
from gvla2.memory.contracts import MemoryTask, Ranked
from gvla2.memory.options import HybridOptions, ScoreWeights
from gvla2.memory.records import SECONDS_PER_DAY
from gvla2.memory.text import subqueries

_LOOKED_AT = 1000
"""Number of the best records that are considered."""


class HybridRetriever:
    """Ranks records by the score S of the paper, with text relevance from words and vectors together."""

    def __init__(self, options: HybridOptions | None = None) -> None:
        self._options = options or HybridOptions()
        self._options.check()

    def rank(
        self, task: MemoryTask, candidates: Candidates, query_embedding: NDArray[np.float32]
    ) -> tuple[Sequence[Ranked], str]:
        """The reliable rows, best first (equal scores by id), or none and the reason.

        ``query_embedding`` (D,) must come from the model of the candidates' vectors. Records of a different skill than
        the task's are left out, if both are known.
        """
        options = self._options
        if not len(candidates):
            return (), "The bank is empty."
        if not subqueries(task.query):
            return (), "The query has no word to search by."
        lexical = candidates.lexical(task.query)
        cosine = np.clip(candidates.cosine(query_embedding), 0.0, 1.0)
        allowed = candidates.of_skill(task.skill)
        if not allowed.any():
            return (), f"No record is about the skill '{task.skill}'."
        evidence = cosine + options.words_count * lexical
        about = allowed & ((evidence >= options.min_evidence) | (lexical >= options.min_words))
        if not about.any():
            nearest = int(np.argmax(np.where(allowed, evidence, -np.inf)))
            return (), (
                f"None of {np.count_nonzero(allowed)} records is about this: the nearest, "
                f"{candidates.record(nearest).id}, has cosine {cosine[nearest]:.2f} and {lexical[nearest]:.0%} of the "
                f"query's words, which counts {evidence[nearest]:.2f} (at least {options.min_evidence:.2f} is "
                f"required, or {options.min_words:.0%} of the words)."
            )
        rows = np.flatnonzero(about)
        relevance = options.lexical_weight * lexical[rows] + options.cosine_weight * cosine[rows]
        # Relative to the best, like BM25 / its maximum: else confidence would outweigh relevance.
        relevance /= max(float(relevance.max()), 1e-9)
        held = [candidates[row] for row in rows.tolist()]
        terms = score_terms(options.weights, held, candidates.now, relevance)
        scores = np.sum(list(terms.values()), axis=0)
        if (best := scores.max()) < options.min_score:
            best_is = f"the best score is {best:.2f}, at least {options.min_score:.2f} is required"
            return (), f"{len(rows)} records are about this, none reliable enough: {best_is}."
        fits = evidence[rows]
        scores[fits < options.min_share * fits[scores >= options.min_score].max()] = -np.inf
        return [
            Ranked(int(rows[i]), float(scores[i]), {name: float(term[i]) for name, term in terms.items()})
            for i in self._chosen(rows, scores, candidates)
        ], ""

    def _chosen(self, rows: NDArray[np.intp], scores: Array, candidates: Candidates) -> list[int]:
        """The indices into ``rows`` (K,) of those shown, best first.

        Constraints, hints and the programs of each language have separate limits: a planner reads programs of one
        language, which those of another must not crowd out.
        """
        options, chosen, shown = self._options, list[int](), Counter[str]()
        for i in np.argsort(-scores, kind="stable")[:_LOOKED_AT].tolist():
            if scores[i] < options.min_score:
                break
            record = candidates.record(int(rows[i]))
            kind, most = "hint", options.top_k
            if (program := (record.effect_json() or {})).get("kind") == "program":
                kind, most = str(program.get("language")), options.programs
            elif record.type == "failure_avoidance":
                kind, most = "constraint", options.top_k_constraints
            if shown[kind] < most:
                shown[kind] += 1
                chosen.append(i)
        return chosen


class SemanticRetriever:
    """The plain baseline: the ``top_k`` nearest vectors, without a threshold.

    It never abstains, except that a query or bank without vectors finds nothing.
    """

    def __init__(self, top_k: int = 6) -> None:  # as many as ``memory=semantic`` recalls
        self._top_k = top_k

    def rank(
        self, task: MemoryTask, candidates: Candidates, query_embedding: NDArray[np.float32]
    ) -> tuple[Sequence[Ranked], str]:
        """The ``top_k`` rows of largest cosine (equal ones by id)."""
        if not len(candidates):
            return (), "The bank is empty."
        if not query_embedding.any():
            return (), "The query has no vector to search by."
        cosines = candidates.cosine(query_embedding)
        best = np.argsort(-cosines, kind="stable")[: self._top_k].tolist()
        return [Ranked(row, float(cosines[row]), {"cosine": float(cosines[row])}) for row in best], ""


def score_terms(
    weights: ScoreWeights, held: Sequence[HeldRecord], now: float, relevance: Array
) -> dict[str, Array]:
    """The terms of S by name, each (K,) for the K records; penalties are negative, so that S is their sum.

    ``now`` in seconds since the epoch; ``relevance`` (K,) is r_text in [0, 1].
    """
    records = [one.record for one in held]
    ages = np.maximum([(now - one.updated) / SECONDS_PER_DAY for one in records], 0.0)
    usage = np.array([one.usage for one in records])
    conflicts = np.array([one.conflicts for one in held])
    avoidance = np.array([one.type == "failure_avoidance" for one in records])
    bonus = {
        "verified_success": weights.verified,
        "verified_fail": weights.failed,
        "uncertain": weights.uncertain,
        "unavailable": weights.unjudged,
    }
    success = [
        weights.verified if warned and one.outcome == "verified_fail" else bonus[one.outcome]
        for one, warned in zip(records, avoidance, strict=True)
    ]
    used = np.minimum(np.log1p(np.maximum(usage, 0)) / weights.usage_divisor, weights.usage_most)
    forgotten = avoidance & (ages > weights.stale_days) & (usage <= 0)
    ageing = np.maximum(np.minimum(ages / 365.0, weights.ageing) - used / 2, 0.0)
    return {
        "r_text": relevance,
        "confidence": np.clip([one.confidence for one in records], 0.0, 1.0),
        "success": np.array(success),
        "recency": np.maximum(weights.recency - ages / weights.recency_days, 0.0),
        "usage": used,
        "conflict": -np.minimum(weights.conflict * conflicts, weights.conflict_most),
        "stale": -np.where(forgotten, weights.stale_failure, ageing),
    }
