"""The retriever of a bank: ranking by S, and silence where nothing fits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Candidates, MemoryTask, Ranked
from gvla2.memory.meaning.words import distinct_topics
from gvla2.memory.retrieval.diversity import Chosen
from gvla2.memory.retrieval.kernels import add_differences, exact_terms, near_best
from gvla2.memory.retrieval.options import HybridOptions
from gvla2.memory.retrieval.ranking import blocks_in_order
from gvla2.memory.retrieval.score_tables import CONSTRAINT, TERMS, ScoreTables

_ALL = np.zeros(0, np.bool_)
_NONE = np.zeros(0)


class HybridRetriever:
    """Ranks records by the score S of the paper, with text relevance from words and vectors together."""

    def __init__(self, options: HybridOptions | None = None) -> None:
        self._options = options or HybridOptions()
        self._tables = ScoreTables(self._options)

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
        if not distinct_topics(task.query):
            return (), "The query has no word to search by."
        scoring = _Scoring(self._tables, options, task, candidates, query_embedding)
        chosen = Chosen(candidates, options)
        best: float | None = None
        for rows, scores in blocks_in_order(scoring.near, scoring.slack, scoring.exact, candidates.ids):
            best = scores[0] if best is None else best
            reliable = sum(score >= options.min_score for score in scores)
            chosen.offer(rows[:reliable])
            if chosen.full or reliable < len(rows):
                break
        if best is None:
            return (), scoring.nothing_relevant()
        if best < options.min_score:
            return (), (
                f"{scoring.relevant()} records are about this, none reliable enough: the best score is {best:.2f}, at "
                f"least {options.min_score:.2f} is asked."
            )
        return scoring.ranked(chosen.rows), ""


class _Scoring:
    """S of all rows for one query: nearly for all, exactly for those asked for."""

    def __init__(
        self,
        tables: ScoreTables,
        options: HybridOptions,
        task: MemoryTask,
        candidates: Candidates,
        vector: NDArray[np.float32],
    ) -> None:
        self._options, self._task = options, task
        self._candidates, self._vector = candidates, vector
        # BM25's statistics are those of the whole bank, whatever the skill asked for.
        self._lexical, self._coverage = candidates.lexical(task.query), candidates.coverage(task.query)
        self._off = candidates.slack(vector)
        self.slack = options.cosine_weight * self._off + 1e-9
        self._near_cosine = candidates.cosine(vector)
        self._allowed = candidates.of_skill(task.skill) if task.skill else _ALL
        self._total, self._shared, self._fits = self._compared()
        self._columns = (
            candidates.confidence, candidates.ages, candidates.usage, candidates.conflicts, candidates.types,
            candidates.outcomes,
        )  # fmt: skip
        self._asked = tables.asked
        self._weights = tables.numbers, tables.bonuses, tables.used, CONSTRAINT
        self._known, self._terms, self._scores = np.zeros(0, np.int64), _NONE, _NONE

    def near(self, count: int) -> tuple[NDArray[np.int64], float]:
        """As :data:`gvla2.memory.retrieval.ranking.Nearly` says."""
        rows, least = near_best(
            self._lexical, self._coverage, self._near_cosine, *self._columns, self._allowed, self._fits,
            self._total, self._shared, self._asked, self._off, *self._weights, count,
        )  # fmt: skip
        return rows, least

    def exact(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """(K,) S of these rows, -inf for those that are not about the query."""
        self._terms, self._scores = exact_terms(
            rows, self._candidates.cosine(self._vector, rows), self._lexical, self._coverage, *self._columns,
            self._total, self._shared, self._asked, *self._weights,
        )  # fmt: skip
        self._known = rows
        return self._scores

    def ranked(self, rows: Sequence[int]) -> list[Ranked]:
        """These rows with their terms, in the order given; they were among those that :meth:`exact` saw last."""
        known = self._known.tolist()
        places = np.array([known.index(row) for row in rows], np.int64)
        found = zip(rows, self._scores[places].tolist(), self._terms[places].tolist(), strict=True)
        return [Ranked(row, score, dict(zip(TERMS, terms, strict=True))) for row, score, terms in found]

    def relevant(self) -> int:
        """How many rows are about the query, for all that is known of their cosines, and fit."""
        return int(np.count_nonzero(self._about() & self._where(self._fits)))

    def nothing_relevant(self) -> str:
        """Why no row counts."""
        allowed = self._where(self._allowed)
        if not allowed.any():
            return f"No record is about the skill '{self._task.skill}'."
        elsewhere = np.count_nonzero(self._about() & ~self._where(self._fits))
        if elsewhere:
            return f"{elsewhere} records are about this, all of them from other geometry."
        options = self._options
        nearest = int(np.argmax(np.where(allowed, self._relevance(), -np.inf)))
        cosine = self._candidates.cosine(self._vector, np.array([nearest]))[0]
        return (
            f"None of {np.count_nonzero(allowed)} records is about this: the nearest, "
            f"{self._candidates.ids[nearest]}, covers {self._coverage[nearest]:.0%} of the query's words (at least "
            f"{options.min_coverage:.0%} are asked) with cosine {min(max(cosine, 0.0), 1.0):.2f} (at least "
            f"{options.min_cosine:.2f})."
        )

    def _relevance(self) -> NDArray[np.float64]:
        options = self._options
        cosine = np.maximum(self._near_cosine, 0.0)
        return np.asarray(options.bm25_weight * self._lexical + options.cosine_weight * cosine)

    def _about(self) -> NDArray[np.bool_]:
        """(N,) which rows are allowed and perhaps about the query: cosines are off by a little."""
        options = self._options
        along = options.min_cosine - self._off if options.min_cosine > 0 else -np.inf
        about = (self._coverage >= options.min_coverage) | (self._near_cosine >= along)
        about &= self._relevance() >= options.min_relevance - self.slack
        return about & self._where(self._allowed)

    def _where(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(N,) a mask, of which (0,) stands for all rows."""
        return mask if len(mask) else np.ones(len(self._lexical), np.bool_)

    def _compared(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """How the task's numbers differ from those of each row.

        ((N,) sums of relative differences, (N,) of how many, (N,) whether all that is essential is near enough);
        (0,) for what is not asked.
        """
        signature = sorted((n, float(v)) for n, v in self._task.signature.items() if math.isfinite(v))
        if not signature:
            return _NONE, _NONE, _ALL
        count, essential = len(self._lexical), self._options.essential
        total, shared = np.zeros(count), np.zeros(count)
        fits = np.ones(count, np.bool_) if any(name in essential for name, _ in signature) else _ALL
        for name, asked in signature:
            known = self._candidates.numbers(name)
            most = self._options.max_difference
            add_differences(known, asked, total, shared, most, fits if name in essential else _ALL)
        return total, shared, fits
