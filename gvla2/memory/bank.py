"""The governed KnowledgeBank: verified experience in, a few reliable records out.

    bank = KnowledgeBank.open("sqlite:///memory.db")
    bank.admit(Lesson("procedural_hint", "Lift the cup 15 cm."), verdict, task="lift the cup")
    print(bank.recall("lift the red cup").text)

What it promises is in :mod:`gvla2.memory.contracts`; what it decides, and how, in :mod:`gvla2.memory.curation`
(admission, consolidation, governance, replay), by what texts mean (:mod:`gvla2.memory.meaning`) and whether they give
orders (:mod:`gvla2.memory.screening`). What is on disk is the truth (:mod:`gvla2.memory.storage`); what is in RAM
follows it (:mod:`gvla2.memory.indexing`) and is ranked (:mod:`gvla2.memory.retrieval`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType
from typing import Any

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import (
    Embedder,
    Inducer,
    Learned,
    Lesson,
    LifecycleState,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Retriever,
    Verdict,
    Verifier,
)
from gvla2.memory.curation.governing import Governed
from gvla2.memory.curation.induction import RulesInducer
from gvla2.memory.curation.replay import Replayed
from gvla2.memory.indexing.index import SERVED, Index
from gvla2.memory.operations import Operations
from gvla2.memory.records import Record
from gvla2.memory.retrieval.hybrid import HybridRetriever
from gvla2.memory.retrieval.recalling import Hit, recall, search
from gvla2.memory.retrieval.semantic import SemanticRetriever
from gvla2.memory.retrieval.static_embedding import StaticEmbedder
from gvla2.memory.storage.store import Event, Link, Problem, Store
from gvla2.memory.storage.vector_audit import foreign_vectors

__all__ = ["BankOptions", "Governed", "Hit", "KnowledgeBank", "Replayed"]
CHUNK = 256
"""Lessons that one transaction of :meth:`KnowledgeBank.admit_many` takes."""


class KnowledgeBank:
    """A named bank in a store, for any number of processes and threads; ``clock`` gives seconds since the epoch.

    Its methods raise :class:`~gvla2.errors.MemoryStoreError` when the store cannot be used; the plugin that offers
    it as a memory turns that into a degraded answer.
    """

    def __init__(
        self,
        store: Store,
        retriever: Retriever | None = None,
        embedder: Embedder | None = None,
        options: BankOptions | None = None,
        *,
        bank: str = "default",
        inducer: Inducer | None = None,
        verifier: Verifier | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.bank = bank
        self.options = options or BankOptions()
        self.options.check()
        self._store, self._clock, self._verifier = store, clock, verifier
        self._embedder = embedder or StaticEmbedder()
        self._retriever: Retriever = retriever or HybridRetriever()
        if self.options.retrieval == "semantic":
            self._retriever = SemanticRetriever()
        self._index = Index(store, bank, self._embedder)
        self._operations = Operations(
            store, self._index, self._embedder, inducer or RulesInducer(), self.options, clock
        )
        self._lock = threading.RLock()

    @classmethod
    def open(
        cls,
        url: str,
        *,
        bank: str = "default",
        retriever: Retriever | None = None,
        embedder: Embedder | None = None,
        inducer: Inducer | None = None,
        verifier: Verifier | None = None,
        options: BankOptions | None = None,
        busy_seconds: float = 5.0,
        clock: Callable[[], float] = time.time,
    ) -> KnowledgeBank:
        """The bank in the database at ``sqlite:///path`` or ``postgresql://…``, created where there is none.

        By default it ranks by words, vectors, quality and geometry, embeds by a table of token vectors, and induces lessons
        by rules. ``verifier`` is who judges stored episodes again. Waits for other processes at most
        ``busy_seconds`` at a time. Raises :class:`~gvla2.errors.ConfigurationError` for options that cannot be.
        """
        store = Store.open(url, busy_seconds=busy_seconds)
        return cls(
            store, retriever, embedder, options, bank=bank, inducer=inducer, verifier=verifier, clock=clock,
        )  # fmt: skip

    # The main job -------------------------------------------------------------------------------------------------

    def recall(self, task: MemoryTask | str) -> MemoryContext:
        """The most reliable records for the task, or none with the reason."""
        with self._lock:
            self._index.refresh()
            candidates = self._index.candidates(self._shown(), now=self._clock())
            return recall(_task(task), candidates, self._retriever, self._embedder, self.options, self.bank)

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what the episode teaches and credit what was recalled for it, in one transaction.

        Then, where a verifier was given and replay is on, one doubtful episode of earlier is verified again.
        """
        if self.options.frozen:
            return Learned(discarded=len(episode.lessons), notes=("The bank is frozen: nothing was learnt.",))
        with self._lock:
            learned = self._operations.learn(episode, verdict)
            if self._verifier is not None and self.options.replay and self.options.replay_per_episode:
                self._operations.replay(
                    self._verifier, limit=self.options.replay_per_episode, but=episode.source
                )
            return learned

    # By hand ------------------------------------------------------------------------------------------------------

    def admit(
        self,
        lessons: Lesson | Sequence[Lesson],
        verdict: Verdict,
        *,
        task: MemoryTask | str = "",
        source: str = "",
    ) -> Learned:
        """Bring in lessons without an episode; durable when it returns."""
        if isinstance(lessons, Lesson):
            lessons = (lessons,)
        return self.admit_many([(lesson, verdict, task, source) for lesson in lessons])

    def admit_many(self, items: Iterable[tuple[Lesson, Verdict, MemoryTask | str, str]]) -> Learned:
        """Bring in many lessons, each with its verdict, task and source ("" for none).

        Durable when it returns; a few hundred share a transaction, so that an error keeps the ones before.
        """
        if self.options.frozen:
            count = sum(1 for _ in items)
            return Learned(discarded=count, notes=("The bank is frozen: nothing was learnt.",))
        parts: list[Learned] = []
        chunk: list[tuple[Lesson, Verdict, MemoryTask, str]] = []
        with self._lock:
            for lesson, verdict, task, source in items:
                chunk.append((lesson, verdict, _task(task), source))
                if len(chunk) == CHUNK:
                    parts.append(self._operations.admit(chunk))
                    chunk = []
            if chunk:
                parts.append(self._operations.admit(chunk))
        return _joined(parts)

    def govern(self) -> Governed:
        """A pass over the whole bank: retire, resolve, sum up, archive; nothing is deleted."""
        if not self.options.governance or self.options.frozen:
            return Governed()
        with self._lock:
            return self._operations.govern()

    def replay(self, verifier: Verifier | None = None, *, limit: int | None = None) -> Replayed:
        """Verify doubtful episodes again, by ``verifier`` or the bank's own, and promote or demote accordingly.

        At most ``limit`` episodes, the least sure first. A verifier that is unavailable changes nothing.
        """
        judge = verifier or self._verifier
        if judge is None:
            return Replayed(notes=["Nobody was given to verify anything again."])
        if not self.options.replay or self.options.frozen:
            return Replayed(notes=["Replay is switched off."])
        with self._lock:
            return self._operations.replay(judge, limit=limit)

    def forget(self, id: str, *, why: str = "") -> bool:
        """Forget a record for good: its text, vector, links, episodes and history. False where there is none."""
        with self._lock:
            with self._store.writing(self.bank, actor="forget", now=self._clock()) as transaction:
                found = transaction.forget(id, why=why)
            self._index.refresh()
            return found

    # Looking ------------------------------------------------------------------------------------------------------

    def records(self, states: Sequence[LifecycleState] | None = None) -> list[Record]:
        """The bank's records in these states (all by default), by id."""
        return self._store.records(self.bank, states)

    def search(self, text: MemoryTask | str, k: int = 20, *, provisional: bool = True) -> list[Hit]:
        """Every score term of the ``k`` nearest records, reliable or not: why something is recalled, or is not."""
        with self._lock:
            self._index.refresh()
            shown = (*SERVED, "provisional") if self.options.show_provisional else SERVED
            states = (*SERVED, "provisional") if provisional else shown
            served, found = (self._index.candidates(s, now=self._clock()) for s in (shown, states))
            return search(_task(text), served, found, self._retriever, self._embedder, k)

    def history(self, id: str) -> list[Event]:
        """All decisions about a record, oldest first."""
        return self._store.history(self.bank, id)

    def as_of(self, time: float) -> list[Record]:
        """The records as they were at ``time``, seconds since the epoch."""
        return self._store.as_of(self.bank, time)

    def conflicts(self) -> list[Link]:
        """Which records contradict each other."""
        return [link for link in self._store.links(self.bank) if link.kind == "conflict"]

    def links(self, id: str | None = None) -> list[Link]:
        """All links, or those of one record."""
        return self._store.links(self.bank, id)

    def verify(self, *, head: str = "") -> list[Problem]:
        """What is wrong with the bank, [] for nothing; its vectors are compared with what this embedder makes.

        ``head`` is "SEQ:HASH" of :meth:`stats`, kept elsewhere: with it, an end that was cut off is found, too.
        """
        problems = self._store.verify(self.bank, head=head)
        with self._store.reading() as view:
            named = {(problem.where, problem.id) for problem in problems}
            found = foreign_vectors(view, self.bank, self._embedder)
        return problems + [problem for problem in found if (problem.where, problem.id) not in named]

    def stats(self) -> dict[str, Any]:
        """Numbers about the bank."""
        return self._store.stats(self.bank)

    def compact(self, *, archived_before: float | None = None) -> int:
        """Give space back; with ``archived_before``, forget archived records not updated since, and count them."""
        if archived_before is None:
            return self._store.compact()
        return self._store.compact(self.bank, archived_before=archived_before, now=self._clock())

    def close(self) -> None:
        """Release the store; safe to call twice."""
        with self._lock:
            self._store.close()

    def __enter__(self) -> KnowledgeBank:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _shown(self) -> tuple[str, ...]:
        return (*SERVED, "provisional") if self.options.show_provisional else SERVED


def _task(task: MemoryTask | str) -> MemoryTask:
    return MemoryTask(task) if isinstance(task, str) else task


def _joined(parts: Sequence[Learned]) -> Learned:
    return Learned(
        added=tuple(id for part in parts for id in part.added),
        merged=tuple(id for part in parts for id in part.merged),
        provisional=tuple(id for part in parts for id in part.provisional),
        discarded=sum(part.discarded for part in parts),
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
    )
