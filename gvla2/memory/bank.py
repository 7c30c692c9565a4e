"""The governed KnowledgeBank: verified experience in, a few reliable records out.

This first version reads the bank's active records anew for each recall, and consolidates by exact identity of what
is said. What it promises is in :mod:`gvla2.memory.contracts`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from sqlmodel import Session, col, select

from gvla2.memory.admission import admit
from gvla2.memory.consolidation import MAX_QUERY, Candidate, Changes, Consolidation
from gvla2.memory.contracts import (
    Candidates,
    Embedder,
    Learned,
    Lesson,
    LifecycleState,
    MemoryContext,
    MemoryEpisode,
    MemoryItem,
    MemoryTask,
    Retriever,
    Verdict,
)
from gvla2.memory.records import Record, clean, dedup_key, dump, finite
from gvla2.memory.rendering import render
from gvla2.memory.store import Store, next_rev

SECONDS_PER_DAY = 86400.0
MAX_CONTENT = 2000


@dataclass(frozen=True)
class BankOptions:
    """How a bank governs: what it admits, shows and spends.

    ``admission`` and ``failures`` are the switches of :func:`gvla2.memory.admission.admit`; ``show_provisional`` lets
    planners see unverified records; ``frozen`` stops learning while recall goes on; ``max_chars`` bounds the text of
    a context; ``max_per_episode`` how many lessons one episode may bring.
    """

    admission: bool = True
    failures: bool = True
    show_provisional: bool = False
    frozen: bool = False
    max_chars: int = 2400
    max_per_episode: int = 16


class KnowledgeBank:
    """A named bank in a store; ``clock`` gives seconds since the epoch.

    Its methods raise :class:`~gvla2.errors.MemoryStoreError` when the store cannot be used; the plugin that offers
    it as a memory turns that into a degraded answer.
    """

    def __init__(
        self,
        store: Store,
        retriever: Retriever,
        embedder: Embedder,
        options: BankOptions | None = None,
        *,
        bank: str = "default",
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.bank = bank
        self.options = options or BankOptions()
        self._store, self._retriever, self._embedder, self._clock = store, retriever, embedder, clock

    @classmethod
    def open(
        cls,
        url: str,
        *,
        retriever: Retriever,
        embedder: Embedder,
        bank: str = "default",
        options: BankOptions | None = None,
        busy_seconds: float = 5.0,
        clock: Callable[[], float] = time.time,
    ) -> KnowledgeBank:
        """The bank in the database at ``sqlite:///path``, created where there is none.

        Waits for other processes at most ``busy_seconds`` at a time.
        """
        store = Store.open(url, busy_seconds=busy_seconds)
        return cls(store, retriever, embedder, options, bank=bank, clock=clock)

    def recall(self, task: MemoryTask) -> MemoryContext:
        """The most reliable records for the task, or none with the reason."""
        states: list[LifecycleState] = ["active", "summary"]
        if self.options.show_provisional:
            states.append("provisional")
        records = [record for record in self._store.records(self.bank, states) if _readable(record)]
        if not records:
            return MemoryContext(abstained=f"The bank '{self.bank}' holds no verified knowledge yet.")
        asked = MemoryTask(clean(task.query, MAX_QUERY), finite(task.signature), task.skill)
        vector = self._embedder.embed([asked.query])[0]
        ranked, reason = self._retriever.rank(asked, self._candidates(records, len(vector)), vector)
        if not ranked:
            return MemoryContext(abstained=reason or "The retriever found nothing reliable.")
        items = tuple(_item(records[rank.row], rank.score, rank.terms) for rank in ranked)
        return MemoryContext(items, render(items, self.options.max_chars))

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what the episode teaches and credit what was recalled for it, in one transaction."""
        if self.options.frozen:
            return Learned(discarded=len(episode.lessons), notes=("The bank is frozen: nothing was learnt.",))
        changes = Changes()
        candidates = self._weigh(episode, verdict, changes)
        consolidation = Consolidation(self.bank, self._embedder.model, self._clock(), episode, verdict)
        with self._store.writing() as session:
            self._credit(session, episode.recalled, verdict)
            for candidate in candidates:
                consolidation.apply(session, candidate, changes)
        return changes.learned()

    def records(self, states: Sequence[LifecycleState] | None = None) -> list[Record]:
        """The bank's rows in these states (all by default), by id."""
        return self._store.records(self.bank, states)

    def close(self) -> None:
        """Release the store; safe to call twice."""
        self._store.close()

    def __enter__(self) -> KnowledgeBank:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _candidates(self, records: Sequence[Record], dimension: int) -> Candidates:
        now, model = self._clock(), self._embedder.model
        return Candidates(
            ids=[r.id for r in records],
            contents=[r.content for r in records],
            queries=[r.query for r in records],
            embeddings=np.stack([r.vector(model, dimension) for r in records]),
            confidence=np.array([r.confidence for r in records], dtype=np.float64),
            outcomes=[r.verified_as for r in records],
            types=[r.record_type for r in records],
            ages=np.array([(now - r.updated) / SECONDS_PER_DAY for r in records], dtype=np.float64),
            usage=np.array([r.usage for r in records], dtype=np.int64),
            conflicts=np.array([r.conflicts() for r in records], dtype=np.int64),
            signatures=[r.signature_json() for r in records],
            skills=[r.skill for r in records],
        )

    def _weigh(self, episode: MemoryEpisode, verdict: Verdict, changes: Changes) -> list[Candidate]:
        """What may be stored, decided and embedded outside the transaction: embedding may take its time."""
        admitted: dict[str, tuple[Lesson, LifecycleState, str]] = {}
        for lesson in episode.lessons:
            bounded = Lesson(lesson.type, clean(lesson.content, MAX_CONTENT), lesson.effect)
            decision = admit(
                bounded, verdict, admission=self.options.admission, failures=self.options.failures
            )
            key = dedup_key(bounded.type, bounded.content, episode.task.skill, bounded.effect)
            note = "" if _storable(bounded.effect) else "A lesson whose effect is no sound JSON was left out."
            if decision.state is None:
                note = decision.note
            elif not note and key not in admitted and len(admitted) >= self.options.max_per_episode:
                note = f"One episode may bring {self.options.max_per_episode} lessons: the rest was left out."
            if decision.state is None or note:
                changes.notes += [] if note in changes.notes else [note]
            else:
                admitted.setdefault(key, (bounded, decision.state, decision.note))
        changes.discarded += len(episode.lessons) - len(admitted)
        query = clean(episode.task.query, MAX_QUERY)
        vectors = self._embedder.embed([f"{query} {lesson.content}" for lesson, _, _ in admitted.values()])
        return [
            Candidate(lesson, state, key, vector, note)
            for (key, (lesson, state, note)), vector in zip(admitted.items(), vectors, strict=True)
        ]

    def _credit(self, session: Session, context: MemoryContext, verdict: Verdict) -> None:
        """Count what was recalled now that the outcome is known; only a success refreshes and rewards it."""
        ids = [item.id for item in context.items]
        if verdict.outcome not in ("verified_success", "verified_fail") or not ids:
            return
        rev = next_rev(session, self.bank)
        for record in session.exec(select(Record).where(Record.bank == self.bank, col(Record.id).in_(ids))):
            record.recalled += 1
            if verdict.outcome == "verified_success":
                record.usage += 1
                record.updated = self._clock()
            record.version += 1
            record.rev = rev
            session.add(record)
        session.flush()


def _item(record: Record, score: float, terms: Mapping[str, float]) -> MemoryItem:
    return MemoryItem(
        id=record.id,
        type=record.record_type,
        content=record.content,
        confidence=record.confidence,
        score=score,
        terms=dict(terms),
        # What was never verified binds nobody, even where the bank is told to show it.
        binding=record.type == "failure_avoidance" and record.state != "provisional",
        effect=record.effect_json(),
    )


def _readable(record: Record) -> bool:
    """Whether a row can be served; a damaged one is passed over, the others are not held up by it."""
    try:
        record.effect_json(), record.signature_json(), record.conflicts()
        return bool(np.isfinite([record.confidence, record.quality, record.updated]).all())
    except (ValueError, TypeError, AttributeError):
        return False


def _storable(effect: Mapping[str, object] | None) -> bool:
    try:
        dump(dict(effect or {})).encode()
    except (TypeError, ValueError):
        return False
    return True
