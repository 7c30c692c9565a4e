"""A whole memory method on a vector store: opened lazily, never blocking the run."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import (
    Embedder,
    Inducer,
    Learned,
    MemoryContext,
    MemoryEpisode,
    MemoryItem,
    MemoryTask,
    Verdict,
)
from gvla2.memory.records import Record
from gvla2.memory.store import Store, check_bank, settled
from gvla2_plugins.memory_baselines import VectorStoreConfig
from gvla2_plugins.memory_baselines.vector_store import Draft, Found, VectorStore


class Method(Protocol):
    """The specifics of a method: what it keeps of an episode, and how it renders entries."""

    @property
    def of_content(self) -> bool:
        """Whether entries are found by their content too, or only by their tasks."""
        ...

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Sequence[Draft], str]:
        """The drafts to keep, and "" or why there are none."""
        ...

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """The bounded block of text, delimited as data."""
        ...


class WholeMethod:
    """The memory of a :class:`Method`. It opens on first use and answers "degraded" if the store fails.

    An invalid address or name of a bank raises :class:`~gvla2.errors.ConfigurationError` immediately.
    """

    def __init__(
        self,
        config: VectorStoreConfig,
        method: Method,
        embedder: Embedder,
        inducer: Inducer | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.url = settled(config.url, os.environ)
        check_bank(config.bank)
        self._config, self._method, self._embedder = config, method, embedder
        self._inducer, self._clock = inducer, clock
        self._store: Store | None = None
        self._entries: VectorStore | None = None

    def recall(self, task: MemoryTask) -> MemoryContext:
        """The most similar entries; an empty context that says why when there are none or the store fails."""
        try:
            found = [
                entry
                for entry in self._open().nearest(task.query, self._config.top_k)
                if entry.similarity > 0
            ]
        except Gvla2Error as error:
            return MemoryContext(degraded=str(error))
        if not found:
            return MemoryContext(abstained=f"The bank '{self._config.bank}' has nothing similar.")
        items = tuple(_item(record, entry.similarity) for entry in found for record in entry.records)
        return MemoryContext(items, self._method.show(items, found, self._config.max_chars))

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what the method learns from the episode (its lessons, or those of an inducer), all of it or nothing."""
        if self._config.frozen:
            return Learned(
                discarded=len(episode.lessons), notes=("The memory is frozen: nothing was learnt.",)
            )
        if self._inducer is not None:
            episode = replace(episode, lessons=self._inducer.induce(episode, verdict))
        drafts, why = self._method.drafts(episode, verdict)
        if not drafts:
            return Learned(discarded=len(episode.lessons), notes=(why,) if why else ())
        try:
            added, grown = self._open().add(drafts, episode, verdict, actor=self._config.name or "memory")
        except Gvla2Error as error:
            return Learned(degraded=str(error))
        return Learned(added=tuple(added), merged=tuple(grown))

    def stats(self) -> dict[str, Any]:
        """Numbers about the bank, see :meth:`Store.stats`; raises Gvla2Error when it cannot be used."""
        return self._open().stats()

    def close(self) -> None:
        """Release the store; safe to call twice."""
        if self._store is not None:
            self._store.close()
        self._store = self._entries = None

    def _open(self) -> VectorStore:
        if self._store is None or self._entries is None:
            self._store = Store.open(self.url, busy_seconds=self._config.busy_seconds)
            self._entries = VectorStore(
                self._store,
                self._config.bank,
                self._embedder,
                of_content=self._method.of_content,
                clock=self._clock,
            )
        return self._entries


def _item(record: Record, similarity: float) -> MemoryItem:
    try:
        effect = record.effect_json()
    except ValueError:
        effect = None
    return MemoryItem(
        id=record.id,
        type=record.type,
        content=record.content,
        confidence=min(max(record.confidence, 0.0), 1.0),
        score=similarity,
        terms={"similarity": similarity},
        binding=record.type == "failure_avoidance",
        effect=effect,
    )
