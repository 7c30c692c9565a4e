"""A memory method on a vector store: entries are found by similarity.

An entry is one or several lessons that are kept, found and shown together (a workflow, an exemplar). They are
records of a bank in the store, so they survive restarts, are shared by processes, and `gvla2 memory` shows them.
"""

from __future__ import annotations

import hashlib
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.admission import confirmed, new_record
from gvla2.memory.contracts import Embedder, Lesson, MemoryEpisode, Verdict
from gvla2.memory.records import Record, clean, dump
from gvla2.memory.store import Store

LONGEST = 100_000


@dataclass(frozen=True)
class Draft:
    """An entry to be kept: its ``lessons``, the leading one first.

    Drafts of the same ``key`` are one entry, whose evidence is pooled; "" makes a new entry each time.
    """

    lessons: tuple[Lesson, ...]
    key: str = ""


Entry = tuple[Record, ...]
"""The records of an entry, its leading one first."""


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
        self.store, self.bank, self._embedder = store, bank, embedder
        self._of_content, self._clock = of_content, clock
        self._vectors: dict[str, NDArray[np.float32]] = {}  # by text: each is embedded once
        self._entries: list[Entry] = []
        self._rev = 0

    def __len__(self) -> int:
        self._refresh()
        return len(self._entries)

    def nearest(self, text: str, k: int) -> list[tuple[Entry, float]]:
        """The ``k`` most similar entries and the cosine of each with the text, in [-1, 1], best first; ties by name."""
        self._refresh()
        if not self._entries or k < 1:
            return []
        matrix = np.stack([self._vector(entry[0]) for entry in self._entries])  # (N, D)
        cosines = matrix @ self._embedder.embed([clean(text, LONGEST)])[0]  # (N,)
        best = np.argsort(-cosines, kind="stable")[:k]
        return [(self._entries[row], float(cosines[row])) for row in best.tolist()]

    def add(
        self, drafts: Sequence[Draft], episode: MemoryEpisode, verdict: Verdict, *, actor: str
    ) -> tuple[list[str], list[str]]:
        """Store the drafts in one transaction; returns the leading records' ids of new entries, and of grown ones."""
        added, grown = list[str](), list[str]()
        with self.store.writing(self.bank, actor=actor, now=self._clock()) as tx:
            for number, draft in enumerate(drafts):
                name = _digest(draft.key or dump([tx.rev, number]))
                for place, lesson in enumerate(draft.lessons):
                    about = str((lesson.effect or {}).get("parameter", ""))
                    key = _digest(dump([name, lesson.type, lesson.content, about] if place else [name, 0]))
                    short = replace(lesson, content=clean(lesson.content, LONGEST))
                    record = new_record(self.bank, short, episode, verdict, tx.now, key=key)
                    known = tx.by_key(key)
                    if known is not None:
                        record = tx.put(confirmed(known, record, episode, verdict, tx.now), action="merge")
                    else:
                        home = dump({**record.provenance_json(), "entry": name, "place": place})
                        record = tx.put(replace(record, provenance=home), action="add")
                    if place == 0:
                        (grown if known else added).append(record.id)
        return added, grown

    def _refresh(self) -> None:
        """Follow the store: new, changed, forgotten or archived entries."""
        with self.store.reading(self.bank) as view:
            if view.rev == self._rev:
                return
            records, self._rev = view.records(["active"]), view.rev
        entries: dict[str, list[tuple[int, str, Record]]] = defaultdict(list)
        for record in records:
            home = record.provenance_json()
            if "entry" in home:
                entries[str(home["entry"])].append((int(home["place"]), record.id, record))
        whole = [sorted(entry, key=lambda one: one[:2]) for _, entry in sorted(entries.items())]
        # An entry exists as long as its leading record.
        self._entries = [tuple(one[2] for one in entry) for entry in whole if entry[0][0] == 0]

    def _vector(self, leading: Record) -> NDArray[np.float32]:
        text = leading.text if self._of_content else leading.query
        if text not in self._vectors:
            rows = self._embedder.embed([text] if self._of_content else text.split("\n"))
            total = rows.sum(axis=0, dtype=np.float64)
            self._vectors[text] = (total / max(float(np.linalg.norm(total)), 1e-12)).astype(np.float32)
        return self._vectors[text]


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()
