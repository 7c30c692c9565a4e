"""The retriever of a bank: ranking by S, and silence where nothing fits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Candidates, MemoryTask, Ranked
from gvla2.memory.diversity import Chosen
from gvla2.memory.ranking import best_first
from gvla2.memory.retrieval_kernels import add_differences, near_scores, rule_out
from gvla2.memory.retrieval_options import HybridOptions
from gvla2.memory.score_columns import CONSTRAINT, Standing, applicability, signature_distances
from gvla2.memory.words import topic_words

_ALL = np.zeros(0, np.bool_)
_NONE = np.zeros(0)


class HybridRetriever:
    """Ranks records by the score S of the paper, with text relevance from words and vectors together."""

    def __init__(self, options: HybridOptions | None = None) -> None:
        self._options = options or HybridOptions()
        self._standing = Standing(self._options.weights)

    def rank(
        self, task: MemoryTask, candidates: Candidates, query_embedding: NDArray[np.float32]
    ) -> tuple[Sequence[Ranked], str]:
        """The reliable rows, best first (equal scores by id), or none and the reason.

        ``query_embedding`` (D,) must come from the model of the candidates' vectors. Records of another skill than
        the task's are left out, where both are known.
        """
        options = self._options
        if not len(candidates.ids):
            return (), "The bank is empty."
        if not topic_words(task.query):
            return (), "The query has no word to search by."
        scoring = _Scoring(self._standing, options, task, candidates, query_embedding)
        if scoring.nearest < 0:
            return (), f"No record is about the skill '{task.skill}'."
        chosen = Chosen(candidates, {True: options.top_k_constraints, False: options.top_k}, options)
        best: float | None = None
        for row, score in best_first(scoring.near, scoring.slack, scoring.exact, candidates.ids):
            best = score if best is None else best
            if score < options.min_score or chosen.full:
                break
            chosen.offer(row, binding=bool(candidates.types[row] == CONSTRAINT))
        if best is None:
            return (), scoring.nothing_relevant()
        if best < options.min_score:
            return (), (
                f"{np.count_nonzero(scoring.near > -np.inf)} records are about this, none reliable enough: the best "
                f"score is {best:.2f}, at least {options.min_score:.2f} is asked."
            )
        return scoring.ranked(chosen.rows), ""


class _Scoring:
    """S of all rows for one query: nearly for all, exactly for those asked for."""

    def __init__(
        self,
        standing: Standing,
        options: HybridOptions,
        task: MemoryTask,
        candidates: Candidates,
        vector: NDArray[np.float32],
    ) -> None:
        self._standing, self._options, self._task = standing, options, task
        self._candidates, self._vector = candidates, vector
        self._known: tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]
        self._signature = {n: float(v) for n, v in task.signature.items() if math.isfinite(v)}
        # BM25's statistics are those of the whole bank, whatever the skill asked for.
        self._lexical, self._coverage = candidates.lexical(task.query), candidates.coverage(task.query)
        off = candidates.slack(vector)
        self.slack = options.cosine_weight * off + 1e-9
        cosine = candidates.cosine(vector)
        allowed = candidates.of_skill(task.skill) if task.skill else _ALL
        self.near = np.empty(len(cosine))  # (N,) S, -inf where a record is not about the query for certain
        total, shared = self._differences()
        self._elsewhere, self.nearest = near_scores(
            self._lexical, self._coverage, cosine, candidates.confidence, candidates.ages, candidates.usage,
            candidates.conflicts, candidates.types, candidates.outcomes, allowed, self._fits(), total, shared,
            # Cosines are off by so much: nobody who might pass is left out here.
            np.array([options.bm25_weight, options.cosine_weight, options.min_coverage, options.min_cosine - off,
                      options.min_relevance - self.slack]),
            standing.numbers, standing.bonuses, standing.used, CONSTRAINT, self.near,
        )  # fmt: skip

    def exact(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """(K,) S of these rows, -inf for those that are not about the query."""
        terms = self._terms(rows)
        self._known = rows, terms
        about = self._about(rows, terms["r_text"])
        return np.where(about, np.sum(list(terms.values()), axis=0), -np.inf)

    def ranked(self, rows: Sequence[int]) -> list[Ranked]:
        """These rows with their terms, in the order given; they were among those that :meth:`exact` saw last."""
        known, columns = self._known
        places = np.searchsorted(known, rows)
        found = zip(*(column[places].tolist() for column in columns.values()), strict=True)
        return [
            Ranked(row, sum(terms), dict(zip(columns, terms, strict=True)))
            for row, terms in zip(rows, found, strict=True)
        ]

    def nothing_relevant(self) -> str:
        """Why no row counts."""
        if self._elsewhere:
            return f"{self._elsewhere} records are about this, all of them from other geometry."
        options, row = self._options, np.array([self.nearest])
        allowed = np.count_nonzero(self._candidates.of_skill(self._task.skill))
        return (
            f"None of {allowed} records is about this: the nearest, {self._candidates.ids[self.nearest]}, covers "
            f"{self._coverage[self.nearest]:.0%} of the query's words (at least {options.min_coverage:.0%} are "
            f"asked) with cosine {self._cosine(row)[0]:.2f} (at least {options.min_cosine:.2f})."
        )

    def _terms(self, rows: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        options = self._options
        relevance = options.bm25_weight * self._lexical[rows] + options.cosine_weight * self._cosine(rows)
        distances = signature_distances(
            self._signature, lambda name: self._candidates.numbers(name, rows), len(rows)
        )
        return {
            "r_text": relevance,
            **self._standing.terms(self._candidates, rows),
            "applicability": applicability(options.weights, distances),
        }

    def _about(self, rows: NDArray[np.int64], relevance: NDArray[np.float64]) -> NDArray[np.bool_]:
        options = self._options
        about = self._coverage[rows] >= options.min_coverage
        if not about.all():
            about |= self._cosine(rows) >= options.min_cosine
        return np.asarray(about & (relevance >= options.min_relevance))

    def _cosine(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """(K,) exact, in [0, 1]."""
        return np.minimum(np.maximum(self._candidates.cosine(self._vector, rows), 0.0), 1.0)

    def _fits(self) -> NDArray[np.bool_]:
        """(N,) whether the records' geometry is near enough to the task's in all that is essential."""
        names = [name for name in self._options.essential if name in self._signature]
        if not names:
            return _ALL
        fits = np.ones(len(self.near), np.bool_)
        for name in names:
            rule_out(
                self._candidates.numbers(name), self._signature[name], self._options.max_difference, fits
            )
        return fits

    def _differences(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """((N,) sums of relative differences to the task's numbers, (N,) of how many)."""
        if not self._signature:
            return _NONE, _NONE
        total, shared = np.zeros(len(self.near)), np.zeros(len(self.near))
        for name, asked in sorted(self._signature.items()):
            add_differences(self._candidates.numbers(name), asked, total, shared)
        return total, shared
