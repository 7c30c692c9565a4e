"""Options of a bank and of its retrievers, as plain data that a component's configuration may inherit."""

from __future__ import annotations

from dataclasses import dataclass, field

from gvla2.component import check_ranges
from gvla2.errors import ConfigurationError


@dataclass
class BankOptions:
    """What a bank admits, shows and keeps.

    Switches, each of them a part of the paper's bank: ``admission`` (off: unverified lessons of ours are admitted too),
    ``replay`` (off: nothing is verified again), ``governance`` (off: nothing is retired, and contradictions stay),
    ``failures`` (off: nothing is learned from failures). The first three are off by default: none of them gained
    anything sure in the learnable worlds (docs/results.md). ``retrieval`` is "full", or "semantic", which ranks by
    similarity alone. ``frozen`` stops learning while recall goes on.

    ``max_chars`` bounds a context, ``active_budget`` and ``provisional_budget`` the records. Governance retires unused
    failures after ``retire_days``. Replay looks at records with a confidence below ``replay_confidence``.
    """

    admission: bool = False
    replay: bool = False
    governance: bool = False
    failures: bool = True
    retrieval: str = "full"
    frozen: bool = False
    max_chars: int = 2400
    active_budget: int = 10_000
    provisional_budget: int = 2_000
    retire_days: float = 14.0
    replay_confidence: float = 0.4

    def check(self, where: str = "BankOptions") -> None:
        """Raises :class:`~gvla2.errors.ConfigurationError` for invalid values; ``where`` they were given."""
        if self.retrieval not in ("full", "semantic"):
            raise ConfigurationError(f"{where}.retrieval is '{self.retrieval}'; it must be full or semantic.")
        sizes = ("max_chars", "active_budget", "provisional_budget", "retire_days")
        check_ranges(self, where, {**dict.fromkeys(sizes, (0, 1e12, "")), "replay_confidence": (0, 1, "")})


@dataclass
class ScoreWeights:
    """The constants of S, as the paper's authors released them.

    Bonuses by the record's outcome: ``verified`` also applies to a constraint that a verified failure supports (the
    released rule counted every failure against its own lesson, which no constraint then survived); ``failed`` for
    anything else that failed; ``unjudged`` if the verifier was unavailable. ``recency`` is lost at one unit in
    ``recency_days``. ``stale_days`` without use make a failure stale; other records lose up to ``ageing`` over a year.
    """

    verified: float = 0.30
    unjudged: float = 0.05
    uncertain: float = -0.25
    failed: float = -0.10
    recency: float = 0.25
    recency_days: float = 90.0
    usage_divisor: float = 8.0
    usage_most: float = 0.20
    conflict: float = 0.15
    conflict_most: float = 0.45
    stale_failure: float = 0.25
    stale_days: float = 14.0
    ageing: float = 0.20


@dataclass(kw_only=True)
class HybridOptions:
    """Options of :class:`gvla2.memory.retrieval.HybridRetriever`.

    Text relevance is ``lexical_weight`` x the share of the query's information in a record's words + ``cosine_weight``
    x cosine, and r_text its share of the best record's. At most ``top_k`` hints are recalled, and besides at most
    ``top_k_constraints`` constraints and ``programs`` programs of each language, so that none crowds out another.

    A record is about the query when its cosine + ``words_count`` x its lexical share is at least ``min_evidence``, or
    that share alone is ``min_words``. It is reliable when its score S is at least ``min_score``. Reliable records that
    have less than ``min_share`` of the best one's evidence are about something else: by their confidence alone they
    would push out what is asked for. ``weights`` are the constants of S. ``words_count`` and ``min_evidence`` were
    calibrated on tests/benchmarks/memory/data, for static and MiniLM alike.
    """

    lexical_weight: float = 0.6
    cosine_weight: float = 0.4
    top_k: int = 3
    top_k_constraints: int = 6
    programs: int = 2
    words_count: float = 0.15
    min_evidence: float = 0.3
    min_words: float = 0.5
    min_score: float = 1.2
    min_share: float = 0.5
    weights: ScoreWeights = field(default_factory=ScoreWeights)

    def check(self) -> None:
        """Raises :class:`~gvla2.errors.ConfigurationError` for weights that make S divide by zero."""
        for name in ("recency_days", "usage_divisor"):
            if getattr(self.weights, name) == 0:
                why = "is 0, and S divides by it: give a positive one"
                raise ConfigurationError(f"The weight '{name}' of the retriever {why}.")
