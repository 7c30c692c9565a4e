"""Ranking by S, and abstention."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Candidates, MemoryTask, Ranked
from gvla2.memory.scoring import score_terms, signature_distance
from gvla2_plugins.hybrid.words import bm25, coverage, topic_words

if TYPE_CHECKING:
    from gvla2_plugins.hybrid import HybridConfig


class HybridRetriever:
    """Ranks records by the score S of the paper, with text relevance from words and vectors together."""

    def __init__(self, config: HybridConfig) -> None:
        self._config = config
        self._words = lru_cache(maxsize=20_000)(lambda text: tuple(topic_words(text)))

    def rank(
        self, task: MemoryTask, candidates: Candidates, query_embedding: NDArray[np.float32]
    ) -> tuple[Sequence[Ranked], str]:
        """The reliable rows, best first (equal scores by id), or none and the reason.

        ``query_embedding`` (D,) must come from the model of ``candidates.embeddings`` (N, D). Records of another
        skill than the task's are left out, where both are known.
        """
        config = self._config
        rows = [
            row
            for row, skill in enumerate(candidates.skills)
            if not (task.skill and skill and skill != task.skill)
        ]
        if not rows:
            return (), f"No record is about the skill '{task.skill}'." if task.skill else "The bank is empty."
        query = topic_words(task.query)
        if not query:
            return (), "The query has no word to search by."
        # BM25's statistics are those of the whole bank, whatever the skill asked for.
        documents = [
            self._words(f"{q} {c}") for q, c in zip(candidates.queries, candidates.contents, strict=True)
        ]
        lexical = bm25(query, documents)
        lexical = lexical / max(float(lexical.max()), 1e-9)
        cosine = np.nan_to_num(candidates.embeddings @ query_embedding).clip(0.0, 1.0)
        relevance = config.bm25_weight * lexical + config.cosine_weight * cosine
        relevant = [
            row
            for row in rows
            if relevance[row] >= config.min_relevance
            and (coverage(query, documents[row]) >= config.min_coverage or cosine[row] >= config.min_cosine)
        ]
        applicable = [row for row in relevant if self._fits(task.signature, candidates.signatures[row])]
        if relevant and not applicable:
            return (), f"{len(relevant)} records are about this, all of them from other geometry."
        if not relevant:
            best = max(rows, key=lambda row: float(relevance[row]))
            return (), (
                f"None of {len(rows)} records is about this: the nearest, {candidates.ids[best]}, covers "
                f"{coverage(query, documents[best]):.0%} of the query's words (at least {config.min_coverage:.0%} "
                f"are asked) with cosine {cosine[best]:.2f} (at least {config.min_cosine:.2f})."
            )
        ranked = [self._score(row, task, candidates, float(relevance[row])) for row in applicable]
        ranked.sort(key=lambda rank: (-rank.score, candidates.ids[rank.row]))
        reliable = [rank for rank in ranked if rank.score >= config.min_score]
        if not reliable:
            return (), (
                f"{len(ranked)} records are about this, none reliable enough: the best score is "
                f"{ranked[0].score:.2f}, at least {config.min_score:.2f} is asked."
            )
        return self._cut(reliable, candidates), ""

    def _fits(self, asked: Mapping[str, float], known: Mapping[str, float]) -> bool:
        shared = [name for name in self._config.essential if name in asked and name in known]
        return all(
            (signature_distance({name: asked[name]}, {name: known[name]}) or 0.0)
            <= self._config.max_difference
            for name in shared
        )

    def _score(self, row: int, task: MemoryTask, candidates: Candidates, relevance: float) -> Ranked:
        terms = score_terms(
            self._config.weights,
            relevance=relevance,
            confidence=float(candidates.confidence[row]),
            outcome=candidates.outcomes[row],
            type=candidates.types[row],
            age=float(candidates.ages[row]),
            usage=int(candidates.usage[row]),
            conflicts=int(candidates.conflicts[row]),
            distance=signature_distance(task.signature, candidates.signatures[row]),
        )
        return Ranked(row, sum(terms.values()), terms)

    def _cut(self, ranked: Sequence[Ranked], candidates: Candidates) -> list[Ranked]:
        """The best of each kind, still in rank order."""
        places = {True: self._config.top_k_constraints, False: self._config.top_k}
        kept = []
        for rank in ranked:
            constraint = candidates.types[rank.row] == "failure_avoidance"
            if places[constraint] > 0:
                places[constraint] -= 1
                kept.append(rank)
        return kept
