"""A shelf of entries found by similarity: what whole memory methods other than the KnowledgeBank stand on.

An entry is one or several lessons that are kept, found and shown together (a workflow, an exemplar). They are
records of a bank in the store, so they survive restarts, are shared by processes, and `gvla2 memory` shows them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Embedder, Lesson, MemoryEpisode, Verdict
from gvla2.memory.methods.shelf_records import (
    LONGEST,
    MAX_QUERY,
    Draft,
    digest,
    fresh,
    grown,
    home_of,
    phrasings,
)
from gvla2.memory.records import Record, clean, dump
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.transaction import Transaction

__all__ = ["Draft", "Found", "Shelf"]


@dataclass(frozen=True)
class Found:
    """An entry and the cosine of its text with what was asked, in [-1, 1]."""

    records: tuple[Record, ...]
    similarity: float


@dataclass
class _Entry:
    """An entry in memory: its records by place and id, and the unit vector of its leading one."""

    records: dict[tuple[int, str], Record] = field(default_factory=dict)
    vector: NDArray[np.float32] | None = None

    def in_order(self) -> tuple[Record, ...]:
        """The records, the leading one first."""
        return tuple(self.records[key] for key in sorted(self.records))

    def leads(self) -> bool:
        """Whether the leading record is there."""
        return any(place == 0 for place, _ in self.records)


class Shelf:
    """The entries of one bank. Not for several threads at once; for any number of processes.

    ``of_content`` embeds "query content" of an entry's leading lesson, otherwise the queries alone are embedded, one
    by one, and their mean stands for the entry. Methods raise :class:`~gvla2.errors.MemoryStoreError` when the store
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
        # Other vectors than an index would make of the same record: they go by another name.
        self._model = f"{embedder.model}/{'lesson' if of_content else 'queries'}"
        self._entries: dict[str, _Entry] = {}
        self._home: dict[str, tuple[str, int]] = {}
        self._rev = 0
        self._names: list[str] = []
        self._matrix = np.zeros((0, 0), dtype=np.float32)

    def __len__(self) -> int:
        self._refresh()
        return len(self._names)

    def nearest(self, text: str, k: int) -> list[Found]:
        """The ``k`` entries whose text is most similar, best first; ties in the order of their names."""
        self._refresh()
        if not self._names or k < 1:
            return []
        asked = self._embedder.embed([clean(text, MAX_QUERY)])[0]
        cosines = self._matrix @ asked  # (N,)
        best = np.argsort(-cosines, kind="stable")[:k]
        found = []
        for row in best:
            found.append(Found(self._entries[self._names[row]].in_order(), float(cosines[row])))
        return found

    def add(
        self, drafts: Sequence[Draft], episode: MemoryEpisode, verdict: Verdict, *, actor: str
    ) -> tuple[list[str], list[str]]:
        """Keep the drafts in one transaction; ids of the leading records of new entries, and of those that grew."""
        added: list[str] = []
        again: list[str] = []
        if not drafts:
            return added, again
        vectors = self._vectors_of(drafts, episode)  # before the lock: embedding may take its time
        with self._store.writing(self.bank, actor=actor, now=self._clock()) as tx:
            for number, draft in enumerate(drafts):
                name = digest(draft.key or dump([tx.rev, number]))
                for place, lesson in enumerate(draft.lessons):
                    vector = vectors[number] if place == 0 else None
                    id, new = self._put(tx, name, place, lesson, vector, episode, verdict)
                    if place == 0:
                        (added if new else again).append(id)
        return added, again

    def _vectors_of(self, drafts: Sequence[Draft], episode: MemoryEpisode) -> list[NDArray[np.float32]]:
        """(D,) of each draft, should it be a new entry."""
        query = phrasings("", episode.task.query)
        if self._of_content:
            return list(
                self._embedder.embed([f"{query} {clean(d.lessons[0].content, LONGEST)}" for d in drafts])
            )
        return [self._embedder.embed([query])[0]] * len(drafts)

    def _put(
        self,
        tx: Transaction,
        name: str,
        place: int,
        lesson: Lesson,
        vector: NDArray[np.float32] | None,
        episode: MemoryEpisode,
        verdict: Verdict,
    ) -> tuple[str, bool]:
        about = (lesson.effect or {}).get("parameter", "")
        key = digest(dump([name, place] if place == 0 else [name, lesson.type, lesson.content, str(about)]))
        known = tx.by_key(key)
        if known is not None:
            # Another wording moves the entry's vector: the store drops the old one, and readers make the new one.
            return tx.put(grown(known, lesson, episode, verdict, tx.now), action="merge").id, False
        record = fresh(self.bank, name, place, key, lesson, episode, verdict, tx.now)
        model = self._model if vector is not None else ""
        return tx.put(record, vector, model=model, action="add").id, True

    def _refresh(self) -> None:
        """Follow the store: entries that are new, have changed, or were forgotten or archived."""
        rev = self._store.rev(self.bank)
        if rev == self._rev:
            return
        late: list[_Entry] = []
        for change in self._store.changes(self.bank, self._rev):
            record = change.record
            rev = max(rev, record.rev)
            name, place = home_of(record) or self._home.get(record.id, ("", 0))
            if not name:
                continue
            self._home[record.id] = name, place
            entry = self._entries.setdefault(name, _Entry())
            if change.forgotten or record.state not in ("active", "summary"):
                entry.records.pop((place, record.id), None)
                continue
            entry.records[place, record.id] = record
            if place == 0:
                entry.vector = change.vector if change.model == self._model else None
                late += [entry] if entry.vector is None else []
        if late:
            for entry, vector in zip(late, self._embed([e.in_order()[0] for e in late]), strict=True):
                entry.vector = vector
        # An entry stands and falls with its leading record.
        self._names = sorted(name for name, entry in self._entries.items() if entry.leads())
        vectors = [self._entries[name].vector for name in self._names]
        self._matrix = np.stack([v for v in vectors if v is not None]) if vectors else self._matrix[:0]
        self._rev = rev

    def _embed(self, records: Sequence[Record]) -> list[NDArray[np.float32]]:
        """(D,) unit vectors of leading records; zero for one that says nothing."""
        if self._of_content:
            return list(self._embedder.embed([f"{r.query} {r.content}" for r in records]))
        made = []
        for record in records:
            total = self._embedder.embed(record.query.split("\n")).astype(np.float64).sum(axis=0)
            length = float(np.linalg.norm(total))
            made.append((total / length if length > 0 else total).astype(np.float32))
        return made
