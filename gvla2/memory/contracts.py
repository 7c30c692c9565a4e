"""What memory methods, retrievers, embedders, verifiers, inducers and judges implement.

The whole of a memory is ``recall(task) -> context`` and ``learn(episode, verdict)``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from gvla2.memory.records import Outcome, RecordType

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gvla2.memory.candidates import Candidates


@dataclass(frozen=True)
class MemoryTask:
    """A query to memory. ``query`` is the instruction, in any language.

    ``skill`` narrows it if known ("" otherwise). ``objects`` are those that could be handled, a label and a shape each
    ("red cup cylinder"): a model's lesson may speak of them.
    """

    query: str
    skill: str = ""
    objects: tuple[str, ...] = ()


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

    ``abstained`` gives the reason when nothing was reliable enough, "" otherwise; ``degraded`` says what went wrong
    with the store (locked, corrupt), "" otherwise: planning then continues without memory.
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
        """The verdict of criterion scores in [0, 1] (paper eq. R_t with the score tokens already summed).

        Raises ``ValueError`` for none, or scores out of range.
        """
        if not criteria or not all(0.0 <= score <= 1.0 for score in criteria.values()):
            raise ValueError(f"A verdict needs criteria with scores in [0, 1], not {dict(criteria)}.")
        quality = math.fsum(criteria.values()) / len(criteria)
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
    """Candidate knowledge drawn from an episode, before admission.

    ``effect`` is what it means for a planner, as JSON by ``kind``: a bound, prior, order or ban of a parameter, or a
    ``program``: ``{"kind": "program", "skill": "pick", "language": "calls", "roles": {"theme": "cup cylinder"},
    "steps": [...]}``, what succeeded, with roles for names and shares for sizes.

    ``evidence`` are verbatim passages of the transcript that support the lesson. A model's lesson needs some to be
    believed immediately.
    """

    type: RecordType
    content: str
    effect: Mapping[str, Any] | None = None
    evidence: tuple[str, ...] = ()


@dataclass(frozen=True)
class MemoryEpisode:
    """Memory's input for learning: the task, what was recalled for it, the candidate lessons, and their source.

    ``transcript`` is the episode in words (plan and execution). ``source`` identifies the run (its episode id);
    ``provenance`` holds plugin names and versions; ``facts`` are named JSON observations (an exit status), kept so
    that the episode can be verified again.
    """

    task: MemoryTask
    lessons: tuple[Lesson, ...]
    transcript: str = ""
    recalled: MemoryContext = MemoryContext()
    source: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Learned:
    """The fate of an episode's lessons: ids by action, with a sentence each.

    ``degraded`` says why nothing could be stored, "" otherwise.
    """

    added: tuple[str, ...] = ()
    merged: tuple[str, ...] = ()
    provisional: tuple[str, ...] = ()
    discarded: int = 0
    notes: tuple[str, ...] = ()
    degraded: str = ""

    @classmethod
    def combined(cls, parts: Iterable[Learned]) -> Learned:
        """The fate of all lessons, each id and sentence once."""
        parts = list(parts)

        def every(name: str) -> tuple[str, ...]:
            return tuple(dict.fromkeys(one for part in parts for one in getattr(part, name)))

        return cls(
            every("added"),
            every("merged"),
            every("provisional"),
            sum(part.discarded for part in parts),
            every("notes"),
            " ".join(dict.fromkeys(part.degraded for part in parts if part.degraded)),
        )


class Memory(Protocol):
    """A whole memory method."""

    def recall(self, task: MemoryTask) -> MemoryContext:
        """Knowledge for the task. A broken store gives an empty context with ``degraded`` set, not an error."""

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Learn from an episode and its verdict; all of it is stored, or nothing."""

    def close(self) -> None:
        """Release the store; safe to call twice."""


class Embedder(Protocol):
    """Maps texts to unit vectors. One with a method ``knows(query)`` says whether the vector of a query means anything;
    if not, the bank searches by words alone.
    """

    @property
    def model(self) -> str:
        """Identifier kept with each stored vector; vectors of other models are not compared."""

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, D) unit rows; an empty text gives a zero row."""


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
        """The reliable rows, best first, and "" or the reason for abstaining (then there are no rows).

        ``query_embedding`` (D,) is the task's query by the model of the candidates' vectors.
        """


@dataclass(frozen=True)
class Evidence:
    """A verifier's input: the episode in words (``transcript``) and named observations (an exit status)."""

    instruction: str
    transcript: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


class Verifier(Protocol):
    """Judges an episode independently of its execution, never from simulator state."""

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict; ``unavailable`` when this verifier cannot judge such evidence or failed."""


class Inducer(Protocol):
    """Draws candidate lessons from an episode, before admission."""

    def induce(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Lesson, ...]:
        """The lessons given the verdict; the episode's own are its ``lessons``."""


@dataclass(frozen=True)
class LessonPair:
    """Two lessons about similar tasks, each with the instructions that it comes from, one per line."""

    first: str
    second: str
    first_query: str = ""
    second_query: str = ""


@dataclass(frozen=True)
class Judgement:
    """A judge's decision on two lessons: whether they contradict each other, None if it is undecided.

    ``probability`` in [0, 1] that they do.
    """

    contradicts: bool | None
    probability: float
    reason: str = ""
    judge: str = ""


class Judge(Protocol):
    """Decides which lessons in words contradict each other, in the background, many pairs at once."""

    def judge(self, pairs: Sequence[LessonPair]) -> Sequence[Judgement]:
        """A judgement for each pair, in order; None with the reason if it could not be obtained."""
