"""What the built-in retrievers can be told; light enough to be a configuration's schema."""

from __future__ import annotations

from dataclasses import dataclass, field

from gvla2.memory.retrieval.scoring import ScoreWeights


@dataclass(kw_only=True)
class HybridOptions:
    """Options of :class:`gvla2.memory.retrieval.hybrid.HybridRetriever`.

    Text relevance is ``bm25_weight`` x BM25 / its maximum + ``cosine_weight`` x cosine. At most ``top_k`` hints are
    recalled, and at most ``top_k_constraints`` constraints beside them: a hint must not crowd out a constraint. A
    record is recalled when its relevance is at least ``min_relevance``, its score S at least ``min_score``, and it
    either shares ``min_coverage`` of the words of the query, or of a sentence of it, or has a cosine of
    ``min_cosine``: BM25 over its own maximum alone would find the best of a bad lot. ``weights`` are the constants
    of S.

    A record from another geometry does not apply, whatever it says: those of the numbers ``essential`` that both
    scenes have may differ by ``max_difference`` of the larger one.

    Records that say the same count once: those of the same words, and those with a cosine above ``same_cosine``
    that share ``same_words`` of the words of both. Lessons about different parameters are never the same.
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
    same_cosine: float = 0.95
    same_words: float = 0.5
    weights: ScoreWeights = field(default_factory=ScoreWeights)


@dataclass(kw_only=True)
class SemanticOptions:
    """Options of :class:`gvla2.memory.retrieval.semantic.SemanticRetriever`: how many it gives at most."""

    top_k: int = 3
