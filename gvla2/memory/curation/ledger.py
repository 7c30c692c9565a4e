"""What one transaction is going to do to a bank: records, links and decisions, collected and then written at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import OUTCOMES, TYPES, Learned
from gvla2.memory.indexing.candidates import RowCandidates
from gvla2.memory.indexing.index import SERVED, Index
from gvla2.memory.indexing.rows import STATES
from gvla2.memory.records import Record, numbered
from gvla2.memory.storage.linking import Tie
from gvla2.memory.storage.store import Link, Put, StoredEpisode, Transaction
from gvla2.memory.storage.view import Change


@dataclass
class Outcome:
    """What becomes of an episode's lessons, as it is decided."""

    added: list[str] = field(default_factory=list)
    merged: list[str] = field(default_factory=list)
    provisional: list[str] = field(default_factory=list)
    discarded: int = 0
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Add a sentence, once."""
        if text and text not in self.notes:
            self.notes.append(text)

    def learned(self) -> Learned:
        """The same as the contract's answer."""
        return Learned(
            tuple(self.added), tuple(self.merged), tuple(self.provisional), self.discarded, tuple(self.notes)
        )


_SPARE = 64
_UNLIKE = 0.25
"""Records with a smaller cosine are no rivals: reading them would be in vain."""


class Ledger:
    """A bank within a transaction: what is stored, what the index finds, and what was decided since.

    The index must be up to date when the transaction begins. Nothing is written before :meth:`write`.
    """

    def __init__(self, transaction: Transaction, index: Index, model: str) -> None:
        self.transaction, self._index, self._model = transaction, index, model
        self._latest: dict[str, Record] = {}
        self._keys: dict[str, str] = {}
        self._vectors: dict[str, NDArray[np.float32]] = {}
        self._near: dict[str, int] = {}
        self._near_ids: list[str] = []
        self._matrix = np.zeros((0, 0), np.float32)
        self._puts: list[Put] = []
        self._links: list[Tie] = []
        self._decisions: list[tuple[str, str, str, Mapping[str, float]]] = []
        self._episodes: dict[str, StoredEpisode] = {}
        self._found: dict[str, list[Record]] = {}
        self._stored: dict[str, Record | None] = {}
        self._by_key: dict[str, Record | None] = {}

    @property
    def now(self) -> float:
        """The time of the transaction, seconds since the epoch."""
        return float(self.transaction.now)

    def get(self, id: str) -> Record | None:
        """The record as it is after what was decided."""
        if id not in self._latest and id not in self._stored:
            self._stored[id] = self.transaction.get(id)  # nothing is written before the end
        return self._latest.get(id) or self._stored[id]

    def expect(self, keys: Iterable[str]) -> None:
        """Look these dedup keys up together, as :meth:`by_key` is going to be asked for them."""
        wanted = [key for key in dict.fromkeys(keys) if key not in self._by_key]
        if len(wanted) > 1:
            self._by_key |= dict.fromkeys(wanted) | self.transaction.view.by_keys(
                self.transaction.bank, wanted
            )

    def records(self, ids: Sequence[str], state: str) -> list[Record]:
        """The records of these ids that are in this state after what was decided, by id."""
        stored = self.transaction.records(states=[state], ids=[id for id in ids if id not in self._latest])
        latest = [self._latest[id] for id in ids if id in self._latest]
        return sorted([*stored, *(r for r in latest if r.state == state)], key=lambda record: record.id)

    def decided(self, record: Record) -> Record:
        """The record as it is after what was decided; one that nothing was decided on is as given."""
        return self._latest.get(record.id, record)

    def by_key(self, key: str) -> Record | None:
        """The record that says the same."""
        if key in self._keys:
            return self._latest[self._keys[key]]
        if key not in self._by_key:
            self._by_key[key] = self.transaction.by_key(key)
        found = self._by_key[key]
        return self._latest.get(found.id, found) if found is not None else None

    def links(self, id: str) -> list[Link]:
        """The record's links, decided ones too."""
        own = [
            Link(tie.source, tie.kind, tie.target, self.now)
            for tie in self._links
            if id in (tie.source, tie.target)
        ]
        return self.transaction.view.links(self.transaction.bank, id) + own

    def nearest(self, vector: NDArray[np.float32], k: int) -> list[tuple[Record, float]]:
        """The served records nearest to a unit (D,) vector with their cosines, best first, equal ones by id.

        Those that are nothing like it are left out.
        """
        found: list[tuple[float, str, int, Record]] = []
        latest = self._latest
        if len(self._index):
            rows, cosines = self._index.nearest(vector, k, SERVED)
            near = rows[: int(np.count_nonzero(cosines >= _UNLIKE))].tolist()
            for place, record in enumerate(map(self._index.record, near)):
                found.append((-float(cosines[place]), record.id, place, latest.get(record.id, record)))
        if self._near:
            alike = self._matrix[: len(self._near)] @ vector
            some = np.flatnonzero(alike >= _UNLIKE)
            best = some[np.argsort(-alike[some], kind="stable")[:k]]
            for place, cosine in zip(best.tolist(), alike[best].tolist(), strict=True):
                id = self._near_ids[place]
                found.append((-cosine, id, k + place, latest[id]))
        kept: dict[str, tuple[Record, float]] = {}
        for cosine, id, _, record in sorted(found):
            kept.setdefault(id, (record, -cosine))
        return [entry for entry in kept.values() if entry[0].state in SERVED][:k]

    def rivals(self, id: str) -> list[Record]:
        """The served records that were found nearest to a record of this transaction, as they are by now."""
        return [record for record in map(self.decided, self._found.get(id, ())) if record.state in SERVED]

    def found(self, id: str, rivals: Sequence[tuple[Record, float]]) -> None:
        """Keep what was found nearest to a record."""
        self._found[id] = [record for record, _ in rivals]

    def vector(self, id: str) -> NDArray[np.float32] | None:
        """The (D,) embedding of a served or changed record, None where it is not at hand."""
        if id in self._vectors:
            return self._vectors[id]
        rows = self._index.rows([id])
        return self._index.vector(rows[0]) if rows else None

    def mean_vector(self, ids: Sequence[str]) -> NDArray[np.float32] | None:
        """(D,) unit mean of the embeddings at hand, None where there is none."""
        found = [vector for id in ids if (vector := self.vector(id)) is not None]
        if not found:
            return None
        total = np.sum(np.stack(found).astype(np.float64), axis=0)
        length = float(np.linalg.norm(total))
        return (total / length).astype(np.float32) if length > 0 else None

    def put(
        self,
        record: Record,
        action: str,
        vector: NDArray[np.float32] | None = None,
        why: str = "",
        scores: Mapping[str, float] | None = None,
    ) -> Record:
        """Decide on a record; returns it as it will be stored."""
        self._puts.append(
            Put(record, action, vector, self._model if vector is not None else "", why, scores or {})
        )
        stored = numbered(record, record.version + 1, self.transaction.rev)
        self._latest[record.id] = stored
        self._keys[record.dedup_key] = record.id
        if vector is not None:
            self._vectors[record.id] = vector
            self._remember(record.id, vector)
        return stored

    def link(self, source: str, kind: str, target: str, why: str = "") -> None:
        """Let one record refer to another."""
        if source != target:
            self._links.append(Tie(source, kind, target, why))

    def decide(
        self, action: str, record: str = "", why: str = "", scores: Mapping[str, float] | None = None
    ) -> None:
        """A decision that changes no record."""
        self._decisions.append((action, record, why, scores or {}))

    def keep(self, episode: StoredEpisode) -> None:
        """Keep an episode for replay."""
        self._episodes[episode.source] = episode

    @property
    def wrote(self) -> bool:
        """Whether anything was decided."""
        return bool(self._puts or self._links or self._decisions or self._episodes)

    def held(self, state: str) -> list[Record]:
        """All records that the bank has in a served state, or provisional, by id."""
        return self._index.records(state)

    def stale(self, days: float) -> list[Record]:
        """Active records not updated for so long, whatever they are."""
        candidates = self._index.candidates(("active",), now=self.now)
        rows = np.flatnonzero((candidates.ages >= days) & (candidates.usage == 0))
        return [self.decided(record) for record in self._of(candidates, rows)]

    def beyond(self, states: Sequence[str], budget: int) -> tuple[list[Record], int]:
        """By how many records some states exceed their budget, and those from which to choose; [] and 0 if not."""
        if sum(map(self._index.count, states)) + len(self._latest) <= budget:
            return [], 0
        held = self._index.candidates(states, now=self.now)
        latest = [record for record in self._latest.values() if record.state in states]
        decided = sum(self._index.count(state, list(self._latest)) for state in states)
        excess = len(held.ids) - decided + len(latest) - budget
        if excess <= 0:
            return [], 0
        verified = (held.outcomes == OUTCOMES.index("verified_success")) | (
            (held.outcomes == OUTCOMES.index("verified_fail"))
            & (held.types == TYPES.index("failure_avoidance"))
        )
        # The columns have no R, but kappa = 2|R - .5| gives it back: R + kappa = .5 + 1.5 kappa.
        rough = (
            1.5 * held.confidence
            + np.where(verified, 0.5, -0.3)
            + np.minimum(0.1 * held.usage, 0.5)
            + np.maximum(0.0, 0.25 - np.minimum(held.ages / 90.0, 0.25))
        )
        many = min(len(rough), excess + decided + _SPARE)
        least = np.argpartition(rough, many - 1)[:many] if many else np.zeros(0, np.int64)
        few = {
            record.id: record for record in map(self.decided, self._of(held, least)) if record.state in states
        }
        return list((few | {record.id: record for record in latest}).values()), excess

    def _of(self, candidates: RowCandidates, rows: NDArray[np.intp]) -> list[Record]:
        return [self._index.record(row) for row in self._index.rows([candidates.ids[int(i)] for i in rows])]

    def changed(self) -> list[Record]:
        """The records decided on, as they will be stored, in the order of their first change."""
        return list(self._latest.values())

    def write(self) -> list[Change] | None:
        """Write all of it; what an index has to apply, None where it had better read the store again."""
        transaction = self.transaction
        last = {record.id: record for record in transaction.put_many(self._puts)} if self._puts else {}
        links = transaction.link_many(self._links) if self._links else []
        for action, record, why, scores in self._decisions:
            transaction.decide(action, record, why=why, scores=scores)
        transaction.save_episodes(self._episodes.values())
        return self._changes(last, links)

    def _changes(self, last: dict[str, Record], made: Sequence[Link]) -> list[Change] | None:
        """The changes of records that are stored as in ``last`` and of those that the links made refer to."""
        own: dict[str, set[str]] = {}
        for link in made:
            for one, other in ((link.source, link.target), (link.target, link.source)):
                against = own.setdefault(one, set())
                if link.kind == "conflict":
                    against.add(other)
        served = {record.id for record in last.values() if record.state in STATES}
        older = (served | (own.keys() - last.keys())) - self.transaction.created
        stored = self.transaction.view.conflicts(self.transaction.bank, older) if older else {}
        conflicts = {id: len(others) for id, others in own.items()} | {id: stored.get(id, 0) for id in older}
        changes = []
        for record in last.values():
            if record.state not in STATES:
                changes.append(Change(record, None, ""))
                continue
            vector = self._vectors.get(record.id)
            if vector is None:
                vector = self._kept_vector(record)
                if vector is None:
                    return None
            changes.append(Change(record, vector, self._model, conflicts.get(record.id, 0)))
        for id in sorted(own.keys() - last.keys()):
            for row in self._index.rows([id]):  # what the index does not hold is archived
                record = self._index.record(row)
                record = numbered(record, record.version, self.transaction.rev)
                vector = self._index.vector(row)
                changes.append(Change(record, vector, self._model, conflicts[id]))
        # As the store lists them: then an index that read them there has its rows in the same order, to the last bit.
        return sorted(changes, key=lambda change: change.record.id)

    def _kept_vector(self, record: Record) -> NDArray[np.float32] | None:
        """(D,) of a record that was put without one, None where the index does not have it."""
        for row in self._index.rows([record.id]):
            old = self._index.record(row)
            if (old.query, old.content) == (record.query, record.content):
                return self._index.vector(row)
        return None

    def _remember(self, id: str, vector: NDArray[np.float32]) -> None:
        if id in self._near:
            self._matrix[self._near[id]] = vector
            return
        if len(self._near) == len(self._matrix):
            grown = np.zeros((max(16, 2 * len(self._matrix)), len(vector)), np.float32)
            grown[: len(self._near)] = self._matrix[: len(self._near)] if len(self._near) else 0.0
            self._matrix = grown
        self._matrix[len(self._near)] = vector
        self._near[id] = len(self._near)
        self._near_ids.append(id)
