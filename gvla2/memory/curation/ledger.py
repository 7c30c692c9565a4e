"""One transaction's changes to a bank: records, links and decisions, collected and then written together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.curation.trust import Origin
from gvla2.memory.indexing.candidates import SERVED
from gvla2.memory.records import Record, numbered
from gvla2.memory.storage.events import Link, StoredEpisode
from gvla2.memory.storage.forgetting import Transaction
from gvla2.memory.storage.writing import Put

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank

_UNLIKE = 0.25
"""Records with a smaller cosine are not rivals and need not be read."""
_EMBEDDED = (*SERVED, "provisional")


@contextmanager
def deciding(bank: KnowledgeBank, actor: str) -> Iterator[BankLedger]:
    """A ledger of the current bank, whose decisions are written at the end; the index then follows."""
    with bank.store.writing(bank.bank, actor=actor, now=bank.clock()) as transaction:
        if bank.index.rev != transaction.rev - 1:
            bank.index.refresh()  # no other writer from here on
        ledger = BankLedger(transaction, bank)
        yield ledger
        ledger.write()
    bank.index.refresh()


class BankLedger:
    """A bank within a transaction: stored records, index lookups, and decisions so far.

    The index must be up to date when the transaction begins. Nothing is written before :meth:`write`.
    """

    def __init__(self, transaction: Transaction, bank: KnowledgeBank) -> None:
        self.transaction, self.index, self.options = transaction, bank.index, bank.options
        self._embedder = bank.embedder
        self.now: float = transaction.now
        self._latest: dict[str, Record] = {}
        self._stored: dict[str, Record | None] = {}
        self._by_key: dict[str, Record | None] = {}
        self._origins: dict[str, list[str]] = {}
        self._vectors: dict[str, NDArray[np.float32]] = {}  # of the present texts
        self._near: dict[str, NDArray[np.float32]] = {}  # by which they are found until then
        self._puts: list[Put] = []
        self._ties: dict[tuple[str, str, str], str] = {}
        self._decisions: list[tuple[str, str, str]] = []
        self._episodes: dict[str, StoredEpisode] = {}

    # Reading ------------------------------------------------------------------------------------------------------

    def get(self, id: str) -> Record | None:
        """The record after the decisions so far."""
        if id not in self._latest and id not in self._stored:
            self._stored[id] = self.transaction.get(id)
        return self._latest.get(id) or self._stored[id]

    def latest(self, record: Record) -> Record:
        """The version after the decisions so far of a record read earlier."""
        return self._latest.get(record.id, record)

    def changed(self) -> list[Record]:
        """The records decided on, as they will be stored, in the order of their first change."""
        return list(self._latest.values())

    def expect(self, keys: Iterable[str]) -> None:
        """Prefetch these dedup keys for :meth:`by_key`."""
        wanted = list(keys)
        found = self.transaction.by_keys(wanted)
        self._by_key |= dict.fromkeys(wanted) | found
        ids = [record.id for record in found.values()]
        self._origins |= {id: [] for id in ids} | self.transaction.origins(ids)

    def by_key(self, key: str) -> Record | None:
        """The record that says the same."""
        if key not in self._by_key:
            self.expect([key])
        found = self._by_key[key]
        return self.latest(found) if found is not None else None

    def origins(self, id: str) -> list[Origin]:
        """The origins of a record's evidence, including decided changes."""
        if id not in self._origins:
            self._origins[id] = self.transaction.origins([id]).get(id, [])
        told = [*self._origins[id], *(put.origin for put in self._puts if put.record.id == id)]
        return [origin for text in told if (origin := Origin.read(text)) is not None]

    def links(self, id: str) -> list[Link]:
        """The record's links, including decided ones."""
        own = [Link(*tie, self.now) for tie in self._ties if id in (tie[0], tie[2])]
        return self.transaction.links([id]) + own

    def nearest(
        self, vector: NDArray[np.float32], k: int, states: Sequence[str] = SERVED
    ) -> list[tuple[Record, float]]:
        """The records of these states nearest to a unit (D,) vector with their cosines, best first, equal ones by id.

        Dissimilar ones are left out.
        """
        near = self.index.nearest(vector, k, states)
        found = {record.id: (self.latest(record), cosine) for record, cosine in near}
        changed = [id for id in self._near if self._latest[id].state in states]
        if changed:
            alike = np.stack([self._near[id] for id in changed]) @ vector
            for place in np.argsort(-alike, kind="stable")[:k].tolist():
                found[changed[place]] = (self._latest[changed[place]], float(alike[place]))
        kept = [one for one in found.values() if one[0].state in states and one[1] >= _UNLIKE]
        return sorted(kept, key=lambda entry: (-entry[1], entry[0].id))[:k]

    def vector(self, record: Record) -> NDArray[np.float32]:
        """(D,) the embedding of a record's text, or of its text when stored."""
        if record.id in self._near:
            return self._near[record.id]
        stored = self.index.vector(record.id)
        return np.asarray(self._embedder.embed([record.text])[0], np.float32) if stored is None else stored

    # Deciding -----------------------------------------------------------------------------------------------------

    def put(
        self,
        record: Record,
        action: str,
        why: str = "",
        *,
        vector: NDArray[np.float32] | None = None,
        near: NDArray[np.float32] | None = None,
        origin: str = "",
    ) -> None:
        """Decide on a record; ``vector`` (D,) is that of its text, if known; ``near`` one by which it is found until it
        is stored.
        """
        before = self._latest.get(record.id)
        if vector is not None:
            self._vectors[record.id] = self._near[record.id] = vector
        elif before is not None and before.text != record.text:
            self._vectors.pop(record.id, None)
        if near is not None:
            self._near.setdefault(record.id, near)
        scores = {"quality": record.quality, "confidence": record.confidence}
        self._puts.append(Put(record, action, None, "", why, scores, origin))
        stored = numbered(record, record.version + 1, self.transaction.rev)
        self._latest[record.id] = self._by_key[record.dedup_key] = stored

    def replace(self, winner: Record, loser: Record, action: str, note: str, why: str) -> None:
        """Archive a record that another one replaces, and link them."""
        self.put(replace(loser, state="archive", note=note), action, note)
        self.link(winner.id, "replaces", loser.id, why)

    def link(self, source: str, kind: str, target: str, why: str = "") -> None:
        """Link one record to another."""
        if source != target:
            self._ties.setdefault((source, kind, target), why)

    def decide(self, action: str, record: str = "", why: str = "") -> None:
        """Note a decision that changes no record."""
        self._decisions.append((action, record, why))

    def keep(self, episode: StoredEpisode) -> None:
        """Keep an episode for replay."""
        self._episodes[episode.source] = episode

    def write(self) -> None:
        """Write all of it. A record whose text is new gets the vector of its text."""
        held = {id: self.index.get(id) for id in self._latest}  # whose vectors the index has
        due = {
            id: last
            for id, last in self._latest.items()
            if last.state in _EMBEDDED and ((known := held[id]) is None or known.text != last.text)
        }
        missing = [id for id in due if id not in self._vectors]
        made = self._embedder.embed([due[id].text for id in missing]) if missing else ()
        self._vectors.update(zip(missing, made, strict=True))
        for id, place in {put.record.id: place for place, put in enumerate(self._puts)}.items():
            if id in due:
                vector, model = self._vectors[id], self._embedder.model
                self._puts[place] = replace(self._puts[place], vector=vector, model=model)
        self.transaction.put_many(self._puts)
        self.transaction.link_many(self._ties)
        for action, record, why in self._decisions:
            self.transaction.decide(action, record, why=why)
        self.transaction.save_episodes(self._episodes.values())
