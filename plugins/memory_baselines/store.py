"""A memory method on a vector store: entries are found by similarity.

An entry is one or several lessons that are kept, found and shown together (a workflow, an exemplar). They are
records of a bank in the store, so they survive restarts, are shared by processes, and `gvla2 memory` shows them.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import Gvla2Error
from gvla2.memory.admission import Weighed, confirmed, new_record
from gvla2.memory.contracts import (
    Embedder,
    Inducer,
    Learned,
    Lesson,
    MemoryContext,
    MemoryEpisode,
    MemoryItem,
    MemoryTask,
    Verdict,
)
from gvla2.memory.records import Record, clean, dump
from gvla2.memory.store import Store, check_bank, settled
from gvla2.memory.transaction import Transaction
from gvla2_plugins.memory_baselines import VectorStoreConfig

LONGEST = 100_000


@dataclass(frozen=True)
class Draft:
    """An entry to be kept: its ``lessons``, the leading one first.

    Drafts of the same ``key`` are one entry, whose evidence is pooled; "" makes a new entry each time.
    """

    lessons: tuple[Lesson, ...]
    key: str = ""


@dataclass(frozen=True)
class Found:
    """An entry, its leading record first, and the cosine of its text with the query, in [-1, 1]."""

    records: tuple[Record, ...]
    similarity: float


class VectorStore:
    """The entries of one bank. Not thread-safe, but safe for any number of processes.

    ``of_content`` embeds "query content" of an entry's leading lesson, otherwise only the queries are embedded, one by
    one, and their mean stands for the entry. Methods raise :class:`~gvla2.errors.MemoryStoreError` when the store
    cannot be used.
    """

    def __init__(
        self,
        store: Store,
        bank: str,
        embedder: Embedder,
        *,
        of_content: bool = False,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._store, self.bank, self._embedder = store, bank, embedder
        self._of_content, self._clock = of_content, clock
        self._records: dict[str, Record] = {}
        self._vectors: dict[str, NDArray[np.float32]] = {}
        self._entries: list[tuple[Record, ...]] = []
        self._matrix = np.zeros((0, 0), np.float32)
        self._rev = 0

    def __len__(self) -> int:
        self._refresh()
        return len(self._entries)

    def stats(self) -> dict[str, Any]:
        """Numbers about the bank."""
        return self._store.stats(self.bank)

    def nearest(self, text: str, k: int) -> list[Found]:
        """The ``k`` entries whose text is most similar, best first; ties by name."""
        self._refresh()
        if not self._entries or k < 1:
            return []
        cosines = self._matrix @ self._embedder.embed([clean(text, LONGEST)])[0]  # (N,)
        best = np.argsort(-cosines, kind="stable")[:k]
        return [Found(self._entries[row], float(cosines[row])) for row in best.tolist()]

    def add(
        self, drafts: Sequence[Draft], episode: MemoryEpisode, verdict: Verdict, *, actor: str
    ) -> tuple[list[str], list[str]]:
        """Store the drafts in one transaction; returns the leading records' ids of new entries, and of grown ones."""
        added: list[str] = []
        again: list[str] = []
        if drafts:
            with self._store.writing(self.bank, actor=actor, now=self._clock()) as tx:
                for number, draft in enumerate(drafts):
                    name = _digest(draft.key or dump([tx.rev, number]))
                    for place, lesson in enumerate(draft.lessons):
                        id, new = self._put(tx, name, place, lesson, episode, verdict)
                        if place == 0:
                            (added if new else again).append(id)
        return added, again

    def _put(
        self, tx: Transaction, name: str, place: int, lesson: Lesson, episode: MemoryEpisode, verdict: Verdict
    ) -> tuple[str, bool]:
        about = str((lesson.effect or {}).get("parameter", ""))
        key = _digest(dump([name, place] if place == 0 else [name, lesson.type, lesson.content, about]))
        shortened = replace(lesson, content=clean(lesson.content, LONGEST))
        fresh = new_record(self.bank, Weighed(shortened, "active", key=key), episode, verdict, tx.now)
        known = tx.by_key(key)
        if known is not None:
            return tx.put(confirmed(known, fresh, episode, verdict, tx.now), action="merge").id, False
        home = dump({**fresh.provenance_json(), "entry": name, "place": place})
        return tx.put(replace(fresh, provenance=home), action="add").id, True

    def _refresh(self) -> None:
        """Follow the store: new, changed, forgotten or archived entries."""
        rev = self._store.rev(self.bank)
        if rev == self._rev:
            return
        with self._store.reading(self.bank) as view:
            changes = view.changes(self._rev)
        for change in changes:
            self._vectors.pop(change.record.id, None)
            self._records.pop(change.record.id, None)
            if change.record.state == "active":
                self._records[change.record.id] = change.record
            rev = max(rev, change.record.rev)
        entries: dict[str, list[tuple[int, str, Record]]] = defaultdict(list)
        for record in self._records.values():
            place = record.provenance_json()
            if isinstance(place.get("entry"), str) and isinstance(place.get("place"), int):
                entries[place["entry"]].append((place["place"], record.id, record))
        # An entry exists as long as its leading record.
        whole = [sorted(entry, key=lambda one: one[:2]) for _, entry in sorted(entries.items())]
        self._entries = [tuple(one[2] for one in entry) for entry in whole if entry[0][0] == 0]
        self._embed([entry[0] for entry in self._entries if entry[0].id not in self._vectors])
        vectors = [self._vectors[entry[0].id] for entry in self._entries]
        self._matrix = np.stack(vectors) if vectors else np.zeros((0, 0), np.float32)
        self._rev = rev

    def _embed(self, leading: Sequence[Record]) -> None:
        """Keep a unit vector (D,) of each leading record, zero for an empty text; each text is embedded once."""
        texts = [[one.text] if self._of_content else one.query.split("\n") for one in leading]
        distinct = list(dict.fromkeys(text for several in texts for text in several))
        if not distinct:
            return
        known = dict(zip(distinct, self._embedder.embed(distinct).astype(np.float64), strict=True))
        for record, several in zip(leading, texts, strict=True):
            total: NDArray[np.float64] = np.sum([known[text] for text in several], axis=0)
            length = float(np.linalg.norm(total))
            self._vectors[record.id] = (total / length if length > 0 else total).astype(np.float32)


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()


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
