"""The retrievers of a bank: by the score S of the paper, with abstention, and by similarity alone.

S(q, X, m) = r_text + kappa + b_success + b_recency + b_usage - p_conflict - p_stale, plus our own terms: the geometric
applicability of robot memories, and whether a program's roles can be filled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import OUTCOMES, TYPES, MemoryTask, Ranked
from gvla2.memory.index import Candidates, largest
from gvla2.memory.options import HybridOptions, ScoreWeights, SemanticOptions
from gvla2.memory.records import dump
from gvla2.memory.text import questions, terms, words

Array = NDArray[np.float64]
_CONSTRAINT = TYPES.index("failure_avoidance")
_FAIL = OUTCOMES.index("verified_fail")
_LOOKED_AT = 256
"""Of constraints, hints and programs each, this many of the best are considered."""
_LANGUAGES = 4
"""Programs of further languages are ignored, so that recall is bounded."""


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
        if not questions(task.query):
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
        rows = np.flatnonzero(about & self._fitting(task, candidates))
        if not len(rows):
            why = "records are about this, all of them from a different geometry"
            return (), f"{np.count_nonzero(about)} {why}."

        relevance = options.lexical_weight * lexical[rows] + options.cosine_weight * cosine[rows]
        filled = np.full(len(rows), math.nan)  # (K,) how well the task's objects can fill a program's roles
        for i in np.flatnonzero(candidates.programs[rows]) if task.objects else ():
            filled[i] = share_filled(candidates.record(int(rows[i])).effect_json(), task.objects)
        scored = score_terms(
            options.weights,
            candidates,
            rows,
            # Relative to the best, like BM25 / its maximum: else confidence would outweigh relevance.
            relevance=relevance / max(float(relevance.max()), 1e-9),
            distance=scene_distance(task.signature, candidates, rows),
            filled=filled,
        )
        scores = np.sum(list(scored.values()), axis=0)
        if (best := scores.max()) < options.min_score:
            best_is = f"the best score is {best:.2f}, at least {options.min_score:.2f} is required"
            return (), f"{len(rows)} records are about this, none reliable enough: {best_is}."
        return [
            Ranked(int(rows[i]), float(scores[i]), {name: float(term[i]) for name, term in scored.items()})
            for i in self._chosen(rows, scores, candidates)
        ], ""

    def _chosen(self, rows: NDArray[np.intp], scores: Array, candidates: Candidates) -> list[int]:
        """The indices into ``rows`` (K,) of those shown, best first, without repeats.

        Constraints, hints and the programs of each language have separate limits: a planner reads programs of one
        language, which those of another must not crowd out.
        """
        options, row = self._options, rows.tolist()
        programs = candidates.programs[rows]
        constraints = (candidates.types[rows] == _CONSTRAINT) & ~programs
        taken: list[int] = []
        for kind, most in (
            (constraints, options.top_k_constraints),
            (~constraints & ~programs, options.top_k),
            (programs, options.programs),
        ):
            some = np.flatnonzero(kind & (scores >= options.min_score))
            if len(some) > _LOOKED_AT:
                some = some[np.argpartition(-scores[some], _LOOKED_AT)[:_LOOKED_AT]]
            groups: dict[str, list[int]] = {}
            for i in sorted(some.tolist(), key=lambda i: (-scores[i], candidates.record(row[i]).id)):
                program = candidates.record(row[i]).effect_json() if programs[i] else None
                language = str(program.get("language")) if program else ""
                if language not in groups and len(groups) == _LANGUAGES:
                    continue
                group = groups.setdefault(language, [])
                if len(group) < most and not any(self._same(row[i], row[j], candidates) for j in group):
                    group.append(i)
            taken += [i for group in groups.values() for i in group]
        return sorted(taken, key=lambda i: (-scores[i], candidates.record(row[i]).id))

    def _same(self, one: int, other: int, candidates: Candidates) -> bool:
        """Whether two records say the same, apart from their effects' numbers (the better record's are shown)."""
        mine, theirs = (_wording(candidates.record(row).content) for row in (one, other))
        if len(mine & theirs) < self._options.same_words * len(mine | theirs):
            return False
        return _parameter(candidates, one) == _parameter(candidates, other)

    def _fitting(self, task: MemoryTask, candidates: Candidates) -> NDArray[np.bool_]:
        """(N,) whether all essential numbers of the scene, if both have them, are near enough."""
        fits = np.ones(len(candidates), np.bool_)
        for name in self._options.essential:
            asked = task.signature.get(name, math.nan)
            if math.isfinite(asked):
                difference = relative_difference(candidates.numbers(name), float(asked))
                fits &= ~(difference > self._options.max_difference)  # nan does not exclude
        return fits


class SemanticRetriever:
    """The plain baseline: the nearest vectors, without a threshold.

    It never abstains, except that a query or bank without vectors finds nothing.
    """

    def __init__(self, options: SemanticOptions | None = None) -> None:
        self._options = options or SemanticOptions()

    def rank(
        self, task: MemoryTask, candidates: Candidates, query_embedding: NDArray[np.float32]
    ) -> tuple[Sequence[Ranked], str]:
        """The ``top_k`` rows of largest cosine (equal ones by id)."""
        if not len(candidates):
            return (), "The bank is empty."
        if not query_embedding.any():
            return (), "The query has no vector to search by."
        if self._options.top_k <= 0:
            return (), "The retriever's top_k is 0."
        cosines = candidates.cosine(query_embedding)
        best = largest(cosines, self._options.top_k, lambda row: candidates.record(row).id)
        return [Ranked(row, float(cosines[row]), {"cosine": float(cosines[row])}) for row in best], ""


@lru_cache(maxsize=1024)
def _wording(content: str) -> frozenset[str]:
    return frozenset(words(content))


def _parameter(candidates: Candidates, row: int) -> str:
    """The parameter of an effect; a program stands for itself."""
    effect = candidates.record(row).effect_json() or {}
    if effect.get("kind") == "program":
        return dump(dict(effect))
    return dump([str(effect.get(name, "")) for name in ("kind", "parameter", "op", "skill")])


# Terms of the score --------------------------------------------------------------------------------------------------


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
    avoidance = candidates.types[rows] == _CONSTRAINT
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


def share_filled(effect: Mapping[str, Any] | None, objects: Sequence[str]) -> float:
    """How well the objects can fill the program's roles, one object each: 0 (no role) to 1 (every role in full).

    A role is filled by the share of its words that the object has: a mug is not a cup, but both may be cylinders. The
    best pairs are taken first. nan without a program or roles, or if the objects are unknown.
    """
    roles = (effect or {}).get("roles")
    if (effect or {}).get("kind") != "program" or not isinstance(roles, Mapping) or not (roles and objects):
        return math.nan
    wanted, offered = [terms(str(role)) for role in roles.values()], [terms(one) for one in objects]
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
