"""The plain baseline retriever: the nearest vectors, without a threshold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import MemoryTask, Ranked
from gvla2.memory.indexing.candidates import Candidates, largest
from gvla2.memory.retrieval.options import SemanticOptions


class SemanticRetriever:
    """Ranks by cosine alone. It never abstains, except that a query or bank without vectors finds nothing."""

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
        cosines = candidates.cosine(query_embedding)
        if self._options.top_k <= 0:
            return (), "The retriever's top_k is 0."
        best = largest(cosines, self._options.top_k, lambda row: candidates.record(row).id)
        return [Ranked(row, float(cosines[row]), {"cosine": float(cosines[row])}) for row in best], ""
