"""The retriever of a bank: ranking by S, and abstention if nothing fits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import TYPES, MemoryTask, Ranked
from gvla2.memory.indexing.candidates import Candidates
from gvla2.memory.meaning.terms import questions, words
from gvla2.memory.records import dump
from gvla2.memory.retrieval.options import HybridOptions
from gvla2.memory.retrieval.scoring import relative_difference, scene_distance, score_terms, share_filled

Array = NDArray[np.float64]
_CONSTRAINT = TYPES.index("failure_avoidance")
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
        about = allowed & (
            (cosine + options.words_count * lexical >= options.min_evidence) | (lexical >= options.min_words)
        )
        if not about.any():
            return (), self._nothing_about(candidates, allowed, lexical, cosine)
        fitting = about & self._fitting(task, candidates)
        if not fitting.any():
            why = "records are about this, all of them from a different geometry"
            return (), f"{np.count_nonzero(about)} {why}."

        rows = np.flatnonzero(fitting)
        relevance = options.lexical_weight * lexical[rows] + options.cosine_weight * cosine[rows]
        filled = np.full(len(rows), math.nan)  # (K,) how well the task's things can fill a program's roles
        for i in np.flatnonzero(candidates.programs[rows]) if task.things else ():
            filled[i] = share_filled(candidates.record(int(rows[i])).effect_json(), task.things)
        terms = score_terms(
            options.weights,
            candidates,
            rows,
            # Relative to the best, like BM25 / its maximum: else confidence would outweigh relevance.
            relevance=relevance / max(float(relevance.max()), 1e-9),
            distance=scene_distance(task.signature, candidates, rows),
            filled=filled,
        )
        scores = np.sum(list(terms.values()), axis=0)
        if (best := scores.max()) < options.min_score:
            best_is = f"the best score is {best:.2f}, at least {options.min_score:.2f} is required"
            return (), f"{len(rows)} records are about this, none reliable enough: {best_is}."
        return [
            Ranked(int(rows[i]), float(scores[i]), {name: float(term[i]) for name, term in terms.items()})
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
                name = str(program.get("language")) if program else ""
                if name not in groups and len(groups) == _LANGUAGES:
                    continue
                group = groups.setdefault(name, [])
                if len(group) < most and not any(self._same(row[i], row[j], candidates) for j in group):
                    group.append(i)
                elif len(group) >= most and not name:
                    break
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

    def _nothing_about(
        self, candidates: Candidates, allowed: NDArray[np.bool_], lexical: Array, cosine: Array
    ) -> str:
        """Why no row qualifies."""
        options = self._options
        evidence = cosine + options.words_count * lexical
        nearest = int(np.argmax(np.where(allowed, evidence, -np.inf)))
        id = candidates.record(nearest).id
        return (
            f"None of {np.count_nonzero(allowed)} records is about this: the nearest, {id}, has cosine "
            f"{cosine[nearest]:.2f} and {lexical[nearest]:.0%} of the query's words, which counts "
            f"{evidence[nearest]:.2f} (at least {options.min_evidence:.2f} is required, or {options.min_words:.0%} of "
            "the words)."
        )


@lru_cache(maxsize=1024)
def _wording(content: str) -> frozenset[str]:
    return frozenset(words(content))


def _parameter(candidates: Candidates, row: int) -> str:
    """The parameter of an effect; a program stands for itself."""
    effect = candidates.record(row).effect_json() or {}
    if effect.get("kind") == "program":
        return dump(dict(effect))
    return dump([str(effect.get(name, "")) for name in ("kind", "parameter", "op", "skill")])
