"""What memory methods, retrievers, embedders and verifiers implement.

The whole of a memory is ``recall(task) -> context`` and ``learn(episode, verdict)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

RecordType = Literal["procedural_hint", "failure_avoidance", "tool_usage"]
LifecycleState = Literal["provisional", "active", "summary", "archive"]
Outcome = Literal["verified_success", "verified_fail", "uncertain", "unavailable"]


@dataclass(frozen=True)
class MemoryTask:
    """What memory is asked about. ``query`` is the instruction, in any language.

    ``signature`` describes the scene's geometry by named numbers (metres, counts), empty for software agents;
    ``skill`` narrows it where it is known ("" otherwise).
    """

    query: str
    signature: Mapping[str, float] = field(default_factory=dict)
    skill: str = ""


@dataclass(frozen=True)
class MemoryItem:
    """One recalled record. ``score`` is the sum of ``terms`` (r_text, confidence, success, ...; paper eq. S).

    ``binding`` is True for constraints (failures to avoid) and False for hints. ``effect`` is a typed effect as
    JSON, or None.
    """

    id: str
    type: RecordType
    content: str
    confidence: float
    score: float
    terms: Mapping[str, float]
    binding: bool
    effect: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class MemoryContext:
    """What memory recalled: items in rank order and one bounded text block, delimited as data.

    ``abstained`` gives the reason when nothing was reliable enough, "" otherwise; ``degraded`` says what went
    wrong with the store (locked, corrupt), "" otherwise: planning goes on without memory then.
    """

    items: tuple[MemoryItem, ...] = ()
    text: str = ""
    abstained: str = ""
    degraded: str = ""


@dataclass(frozen=True)
class Verdict:
    """A verifier's judgement: ``quality`` R in [0, 1] is the mean of ``criteria``; ``confidence`` is 2|R - .5|.

    >= .70 is ``verified_success``, <= .35 ``verified_fail``, else ``uncertain``. A verifier that could not judge
    is ``unavailable`` (quality and confidence are then meaningless), never a midpoint.
    """

    outcome: Outcome
    quality: float
    confidence: float
    criteria: Mapping[str, float] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()
    verifier: str = ""

    @classmethod
    def from_criteria(
        cls, criteria: Mapping[str, float], reasons: Sequence[str] = (), verifier: str = ""
    ) -> Verdict:
        """The verdict of criterion scores in [0, 1] (paper eq. R_t with the score tokens already summed)."""
        quality = float(np.mean(list(criteria.values())))
        outcome: Outcome = (
            "verified_success" if quality >= 0.70 else "verified_fail" if quality <= 0.35 else "uncertain"
        )
        return cls(outcome, quality, 2 * abs(quality - 0.5), dict(criteria), tuple(reasons), verifier)

    @classmethod
    def unavailable(cls, reason: str, verifier: str = "") -> Verdict:
        """The verdict of a verifier that could not judge."""
        return cls("unavailable", 0.0, 0.0, {}, (reason,), verifier)


@dataclass(frozen=True)
class Lesson:
    """Candidate knowledge drawn from an episode, before admission."""

    type: RecordType
    content: str
    effect: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class MemoryEpisode:
    """What memory learns from: the task, what was recalled for it, the candidate lessons, and where they come from.

    ``transcript`` is the episode in words (plan and execution). ``source`` identifies the run (its episode id);
    ``provenance`` holds plugin names and versions.
    """

    task: MemoryTask
    lessons: tuple[Lesson, ...]
    transcript: str = ""
    recalled: MemoryContext = MemoryContext()
    source: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Learned:
    """What became of an episode's lessons: ids by action, with a sentence each.

    ``degraded`` says why nothing could be stored, "" otherwise.
    """

    added: tuple[str, ...] = ()
    merged: tuple[str, ...] = ()
    provisional: tuple[str, ...] = ()
    discarded: int = 0
    notes: tuple[str, ...] = ()
    degraded: str = ""


class Memory(Protocol):
    """A whole memory method."""

    def recall(self, task: MemoryTask) -> MemoryContext:
        """Knowledge for the task. A broken store gives an empty context with ``degraded`` set, not an error."""
        ...

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Draw on an episode and its verdict; all of it is stored, or nothing."""
        ...

    def close(self) -> None:
        """Release the store; safe to call twice."""
        ...


class Embedder(Protocol):
    """Maps texts to unit vectors."""

    @property
    def model(self) -> str:
        """Identifier kept with each stored vector; vectors of other models are not compared."""
        ...

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, D) unit rows; an empty text gives a zero row."""
        ...


@dataclass(frozen=True)
class Candidates:
    """What a retriever ranks: N records as parallel columns.

    ``contents`` and ``queries`` texts; ``embeddings`` (N, D) of "query content"; ``confidence`` (N,) in [0, 1];
    ``outcomes`` of their verification; ``types``; ``ages`` (N,) days since the last update; ``usage`` (N,)
    counts; ``conflicts`` (N,) counts; ``signatures`` scene geometry; ``skills`` ("" for any).
    """

    ids: Sequence[str]
    contents: Sequence[str]
    queries: Sequence[str]
    embeddings: NDArray[np.float32]
    confidence: NDArray[np.float64]
    outcomes: Sequence[Outcome]
    types: Sequence[RecordType]
    ages: NDArray[np.float64]
    usage: NDArray[np.int64]
    conflicts: NDArray[np.int64]
    signatures: Sequence[Mapping[str, float]]
    skills: Sequence[str]


@dataclass(frozen=True)
class Ranked:
    """One ranked candidate: its row, score S and the score's terms by name."""

    row: int
    score: float
    terms: Mapping[str, float]


class Retriever(Protocol):
    """Ranks records for a task, or abstains."""

    def rank(
        self, task: MemoryTask, candidates: Candidates, query_embedding: NDArray[np.float32]
    ) -> tuple[Sequence[Ranked], str]:
        """The reliable rows, best first, and "" or the reason for abstaining (then there are no rows)."""
        ...


@dataclass(frozen=True)
class Evidence:
    """What a verifier judges: the episode in words (``transcript``) and named observations (an exit status)."""

    instruction: str
    transcript: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


class Verifier(Protocol):
    """Judges an episode apart from whoever executed it, never from simulator state."""

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict; ``unavailable`` when this verifier cannot judge such evidence or failed itself."""
        ...
