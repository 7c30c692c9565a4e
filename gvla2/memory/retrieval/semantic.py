"""The plain retriever that others compare with: the nearest vectors, whatever they are worth."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Candidates, MemoryTask, Ranked
from gvla2.memory.retrieval.kernels import largest
from gvla2.memory.retrieval.options import SemanticOptions
from gvla2.memory.retrieval.ranking import best_first


class SemanticRetriever:
    """Ranks by cosine alone. It never abstains, save that a query or a bank without any vector finds nothing."""

    def __init__(self, options: SemanticOptions | None = None) -> None:
        self._options = options or SemanticOptions()

    def rank(
        self, task: MemoryTask, candidates: Candidates, query_embedding: NDArray[np.float32]
    ) -> tuple[Sequence[Ranked], str]:
        """The ``top_k`` rows of largest cosine (equal ones by id)."""
        if not len(candidates.ids):
            return (), "The bank is empty."
        if not query_embedding.any():
            return (), "The query has no vector to search by."
        order = best_first(
            partial(largest, candidates.cosine(query_embedding)),
            candidates.slack(query_embedding),
            lambda rows: candidates.cosine(query_embedding, rows),
            candidates.ids,
        )
        return [
            Ranked(row, cosine, {"cosine": cosine}) for row, cosine in islice(order, self._options.top_k)
        ], ""
