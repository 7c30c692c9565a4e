"""The hybrid retriever: words and vectors together, and silence where nothing fits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.memory.scoring import ScoreWeights

if TYPE_CHECKING:
    from gvla2.memory.contracts import Retriever


@dataclass
class HybridConfig(ComponentConfig):
    """Options of the ``hybrid`` retriever.

    Text relevance is ``bm25_weight`` x BM25 / its maximum + ``cosine_weight`` x cosine. At most ``top_k`` hints are
    recalled, and at most ``top_k_constraints`` constraints beside them: a hint must not crowd out a constraint. A
    record is recalled when its relevance is at least ``min_relevance``, its score S at least ``min_score``, and it
    either shares ``min_coverage`` of the query's words or has a cosine of ``min_cosine``: BM25 over its own
    maximum alone would find the best of a bad lot. ``weights`` are the constants of S.

    A record from another geometry does not apply, whatever it says: those of the numbers ``essential`` that both
    scenes have may differ by ``max_difference`` of the larger one.
    """

    bm25_weight: float = 0.5
    cosine_weight: float = 0.5
    top_k: int = 3
    top_k_constraints: int = 3
    min_relevance: float = 0.08
    min_score: float = 1.2
    min_coverage: float = 0.3
    min_cosine: float = 0.35
    max_difference: float = 0.5
    essential: list[str] = field(default_factory=lambda: ["theme_length", "theme_width", "theme_height"])
    weights: ScoreWeights = field(default_factory=ScoreWeights)


def _build(config: HybridConfig) -> Retriever:
    """Ranks by BM25, cosine, quality and geometry; abstains when nothing is reliable enough."""
    from gvla2_plugins.hybrid.retriever import HybridRetriever

    return HybridRetriever(config)


@hookimpl
def gvla2_retrievers() -> list[Component[Retriever]]:
    """The one retriever of this plugin."""
    return [Component("hybrid", HybridConfig, _build)]
