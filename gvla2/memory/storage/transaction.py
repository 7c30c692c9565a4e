"""Writing to a bank: rows, vectors, links and the events that say why, whole or nothing."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.forgetting.quotes import Gone
from gvla2.memory.records import FORGOTTEN, Record, clean, dump, finite
from gvla2.memory.storage.database import Connection
from gvla2.memory.storage.episode_lookup import EpisodeLookup
from gvla2.memory.storage.episodes import StoredEpisode
from gvla2.memory.storage.events import (
    EVENT_COLUMNS,
    GENESIS,
    RESERVED,
    Link,
    chain_hash,
    payload_digest,
)
from gvla2.memory.storage.linking import Tie, link_many
from gvla2.memory.storage.putting import Put, put_many
from gvla2.memory.storage.view import View, models_of

if TYPE_CHECKING:
    from gvla2.memory.storage.repairing import Repaired

MAX_WHY = 2000
LATEST = 253402300799.0
"""The last second of the year 9999: what no calendar knows, no clock means, and later times could not follow it."""
_EVENT = f"INSERT INTO memory_event VALUES ({', '.join('?' * len(EVENT_COLUMNS))})"
_HEAD = (
    "INSERT INTO memory_bank (bank, rev, seq, hash, at, models) VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT (bank) "
    "DO UPDATE SET rev = excluded.rev, seq = excluded.seq, hash = excluded.hash, at = excluded.at, "
    "models = excluded.models"
)
_EPISODE = (
    "INSERT INTO memory_episode (bank, source, rev, at, data) VALUES (?, ?, ?, ?, ?) ON CONFLICT (bank, source) "
    "DO UPDATE SET rev = excluded.rev, at = excluded.at, data = excluded.data"
)


class Transaction:
    """Changes of one bank under one ``rev``, made by ``actor`` at ``now`` (never before the bank's last change).

    Handed out by :meth:`Store.writing`, which holds the bank's write lock from the start: what is read here stays
    so until the end. Free text in ``why`` is kept as it is: it should not quote what may have to be forgotten.
    """

    def __init__(self, connection: Connection, bank: str, actor: str, now: float) -> None:
        if not abs(now) <= LATEST:
            raise MemoryStoreError(
                f"The time of a change must be a finite number of seconds, before the year 10000, not {now}."
            )
        self._sql, self._view = connection, View(connection)
        head = connection.row("SELECT rev, seq, hash, at, models FROM memory_bank WHERE bank = ?", (bank,))
        rev, self._seq, self._hash, last, models = head or (0, 0, GENESIS, now, "{}")
        self.bank = bank
        self.actor = clean(actor, 200)
        self.rev: int = rev + 1
        self.now = max(float(now), last)
        self.models: dict[str, int] = models_of(models)
        self._began = self._written = self._seq
        self.forgotten: list[str] = []
        """Ids that :meth:`forget` took out, and summaries that held them."""
        self.also: list[str] = []
        """Sentences on what else :meth:`forget` had to change; complete when the transaction has ended."""
        self.gone: list[Gone] = []
        """What the forgotten records said, until the transaction ends."""
        self.episodes = EpisodeLookup(connection, bank)
        """What finds the episodes behind a record."""
        self.to_scrub = False
        """Whether the files have to be cleaned after the commit."""
        self.written: set[str] = set()
        """Ids of the records that were put: they are sound, and of this rev."""
        self.created: set[str] = set()
        """Those of them that were not there before."""
        self.linked: set[str] = set()
        """Ids of the records that links were made of."""
        self._events: list[tuple[object, ...]] = []

    # Reading ------------------------------------------------------------------------------------------------------

    def get(self, id: str) -> Record | None:
        """The record, None where there is none, or a damaged or forgotten one."""
        return self._view.get(self.bank, id)

    def by_key(self, dedup_key: str) -> Record | None:
        """The record that says the same, None where there is none."""
        return self._view.by_key(self.bank, dedup_key)

    def records(self, states: Sequence[str] | None = None, ids: Sequence[str] | None = None) -> list[Record]:
        """The records in these states, with these ids (all by default), by id."""
        return self._view.records(self.bank, states, ids)

    @property
    def view(self) -> View:
        """Every other way to read, within this transaction."""
        self.flush()
        return self._view

    # Writing ------------------------------------------------------------------------------------------------------

    def put(
        self,
        record: Record,
        vector: NDArray[np.floating] | None = None,
        *,
        model: str = "",
        action: str,
        why: str = "",
        scores: Mapping[str, float] | None = None,
    ) -> Record:
        """Store a record and the event that says why; returns it as stored.

        A record of version 0 is new; any other must be of the version that is stored, or :class:`StaleRecordError`
        is raised. ``vector`` (D,) finite numbers is the embedding of its text by ``model``; without one the stored
        vector stays, unless the text (query or content) changed. NUL and lone surrogates are taken out of the
        text. Raises :class:`MemoryStoreError` for numbers that are not finite, unsound JSON, a vector of another
        length than the others of its model, and a dedup key that belongs to another record.
        """
        return self.put_many([Put(record, action, vector, model, why, scores or {})])[0]

    def put_many(self, puts: Sequence[Put]) -> list[Record]:
        """The same for many, faster; the same id may come more than once."""
        return put_many(self, self._sql, puts)

    def link(
        self, source: str, kind: str, target: str, *, why: str = "", scores: Mapping[str, float] | None = None
    ) -> bool:
        """Let ``source`` refer to ``target``; False where it does already. Both count as changed (rev)."""
        return bool(link_many(self, self._sql, [Tie(source, kind, target, why, scores or {})]))

    def link_many(self, ties: Sequence[Tie]) -> list[Link]:
        """The same for many, faster; those that were not there already."""
        return link_many(self, self._sql, ties)

    def unlink(
        self, source: str, kind: str, target: str, *, why: str = "", scores: Mapping[str, float] | None = None
    ) -> bool:
        """Take a link away; False where there is none. Both ends count as changed (rev)."""
        gone = self._sql.run(
            "DELETE FROM memory_link WHERE bank = ? AND source = ? AND kind = ? AND target = ?",
            (self.bank, source, kind, target),
        )
        if gone:
            self.touch([source, target])
            self.record_event(f"unlink:{kind}", source, target, why=why, scores=scores)
        return bool(gone)

    def decide(
        self, action: str, record: str = "", *, why: str = "", scores: Mapping[str, float] | None = None
    ) -> None:
        """An event for a decision that changes no row (a lesson was discarded, a pass of governance was made)."""
        self.check_action(action)
        self.record_event(action, clean(record, 200), why=why, scores=scores)

    def save_episode(self, episode: StoredEpisode) -> None:
        """Keep an episode for replay, in place of what is stored for its source; its digest goes on the chain."""
        self.save_episodes([episode])

    def save_episodes(self, episodes: Iterable[StoredEpisode]) -> None:
        """The same for many, faster."""
        rows = []
        for episode in episodes:
            source = clean(episode.source, 200)
            if not source or not math.isfinite(episode.at):
                raise MemoryStoreError("An episode can be stored under a source and with a finite time only.")
            try:
                data = episode.to_json()
            except (ValueError, TypeError, RecursionError) as error:
                raise MemoryStoreError(f"The episode '{source}' is no sound JSON: {error}.") from error
            rows.append((self.bank, source, self.rev, float(episode.at), data))
        if rows:
            self._sql.run_many(_EPISODE, rows)
            self.episodes = EpisodeLookup(self._sql, self.bank)
        for _, source, _, at, data in rows:
            # A random name: what stands in an event's header, as the source would, can never be forgotten.
            change = dump({"episode": episode_digest(at, data), "source": source})
            self.record_event("episode", f"episode-{os.urandom(8).hex()}", change=change)

    def forget(self, id: str, *, why: str = "") -> bool:
        """Forget a record for good: row, vector, links, its episodes' text, and what events say of it.

        Its id, and the fact that it was forgotten, stay. Before the commit, summaries that held it are built anew
        without it, and what others say of it is erased (:attr:`also` tells). After the commit, the store sees to it
        that no byte is left in the database's files. False where there is no such record.
        """
        from gvla2.memory.forgetting.forgetting import forget

        self.flush()
        return forget(self, self._sql, id, why)

    def repair(self, vectors: Collection[str] = ()) -> Repaired:
        """Make rows, vectors and links that were changed behind the bank's back what its events say.

        Rows that no event created are forgotten; damaged vectors, and those of the ids in ``vectors``, are made again
        when the bank is asked next. What was stored of episodes cannot be had again. Raises
        :class:`MemoryStoreError` where the events were changed, too.
        """
        from gvla2.memory.storage.repairing import repair

        return repair(self, self._sql, vectors)

    # For the store's own modules ----------------------------------------------------------------------------------

    @property
    def seq(self) -> int:
        """The number of the last event."""
        return int(self._seq)

    def touch(self, ids: Sequence[str]) -> None:
        """Let these records count as changed (rev), so that an index hears of it."""
        self._sql.run_many(
            "UPDATE memory SET rev = ? WHERE bank = ? AND id = ? AND state <> ?",
            [(self.rev, self.bank, id, FORGOTTEN) for id in ids],
        )

    def check_action(self, action: str) -> None:
        """Raises :class:`MemoryStoreError` for a name that only the store itself may give an event."""
        if not action or action.partition(":")[0] in RESERVED:
            raise MemoryStoreError(f"'{action}' cannot be the name of a decision: choose another one.")

    def record_event(
        self,
        action: str,
        record: str = "",
        target: str = "",
        *,
        why: str = "",
        scores: Mapping[str, float] | None = None,
        change: str = "",
    ) -> None:
        """Write the next event of the chain."""
        event = self.next_event(action, record, target, why=why, scores=scores, change=change)
        self.record_events([event])

    def record_events(self, events: Sequence[tuple[object, ...]]) -> None:
        """Write events that :meth:`next_event` made, in their order: together with later ones, by :meth:`flush`."""
        self._events += events
        self._written += len(events)

    def flush(self) -> None:
        """Write the events up to now; done before anything is read in ways that could show them."""
        if self._events:
            self._sql.run_many(_EVENT, self._events)
            self._events.clear()

    def next_event(
        self,
        action: str,
        record: str = "",
        target: str = "",
        *,
        why: str = "",
        scores: Mapping[str, float] | None = None,
        change: str = "",
    ) -> tuple[object, ...]:
        """The row of the next event of the chain; it must be written."""
        salt, why = os.urandom(16), clean(why, MAX_WHY)
        scored = dump(finite(scores)) if scores else "{}"
        digest = payload_digest(salt, why, scored, change)
        self._seq += 1
        header = (self.bank, self._seq, self.rev, self.now, self.actor, clean(action, 64), record, target)
        prev, self._hash = self._hash, chain_hash(self._hash, *header, digest)
        return (*header, why, scored, change, salt, digest, prev, self._hash)

    def finish(self) -> None:
        """Advance the head of the chain, if anything happened; the last thing before the commit."""
        if self.gone:
            from gvla2.memory.forgetting.mending import mend

            self.flush()
            mend(self, self._sql)
        if self._seq != self._written:
            raise MemoryStoreError("A change failed midway, so that its transaction cannot be committed.")
        self.flush()
        if self._seq != self._began:
            row = (self.bank, self.rev, self._seq, self._hash, self.now, dump(self.models))
            self._sql.run(_HEAD, row)


def episode_digest(at: float, data: str) -> str:
    """What the chain keeps of a stored episode."""
    return hashlib.sha256(dump([at, data]).encode()).hexdigest()
