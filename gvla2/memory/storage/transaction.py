"""Writing to a bank: rows, vectors, links, episodes and the events that say why, whole or nothing."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, delete, insert

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import Record, clean, dump
from gvla2.memory.storage.chain import Chain
from gvla2.memory.storage.database import upsert
from gvla2.memory.storage.episodes import StoredEpisode
from gvla2.memory.storage.events import Link, episode_digest
from gvla2.memory.storage.forgetting import Forgotten, forget_many
from gvla2.memory.storage.putting import Put, put_many
from gvla2.memory.storage.repairing import Repaired, repair
from gvla2.memory.storage.tables import EPISODE, LINK, TAUGHT
from gvla2.memory.storage.view import View


@dataclass(frozen=True, slots=True)
class Tie:
    """One link to be made and the decision behind it, see :meth:`Transaction.link`."""

    source: str
    kind: str
    target: str
    why: str = ""
    scores: Mapping[str, float] = field(default_factory=dict)


class Transaction:
    """Changes of one bank under one ``rev``, made by ``actor`` at ``now`` (never before the bank's last change).

    Handed out by :meth:`Store.writing`, which holds the bank's write lock from the start: what is read here stays
    so until the end. Reasons (``why``) and a record's ``note`` may name other records by id, and must not quote them:
    forgetting a record does not look for its words in the reasons of others (those of links to it aside).
    """

    def __init__(self, connection: Connection, bank: str, actor: str, now: float) -> None:
        self._chain = Chain(connection, bank, actor, now)
        self._done = Forgotten()
        self.bank, self.rev, self.now = bank, self._chain.rev, self._chain.now

    # Reading ------------------------------------------------------------------------------------------------------

    def get(self, id: str) -> Record | None:
        """The record, None where there is none, or a damaged or forgotten one."""
        return self._chain.view.get(self.bank, id)

    def records(
        self, states: Sequence[str] | None = None, ids: Collection[str] | None = None
    ) -> list[Record]:
        """The records in these states, with these ids (all by default), by id."""
        return self._chain.view.records(self.bank, states, ids)

    @property
    def view(self) -> View:
        """Every other way to read, within this transaction."""
        return self._chain.view

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
        origin: str = "",
    ) -> Record:
        """Store a record and the event that says why; returns it as stored.

        A record of version 0 is new; any other must be of the version that is stored, or :class:`StaleRecordError`
        is raised. ``vector`` (D,) finite numbers is the embedding of its text by ``model``; without one the stored
        vector stays, unless the text (query or content) changed. NUL and lone surrogates are taken out of the
        text. ``origin`` says who brought the evidence, "" for nobody. Raises :class:`MemoryStoreError` for numbers
        that are not finite, unsound JSON, a vector of another length than the others of its model, and a dedup key
        that belongs to another record.
        """
        return self.put_many([Put(record, action, vector, model, why, scores or {}, origin)])[0]

    def put_many(self, puts: Sequence[Put]) -> list[Record]:
        """The same for many, faster; the same id may come more than once."""
        return put_many(self._chain, puts)

    def link(
        self, source: str, kind: str, target: str, *, why: str = "", scores: Mapping[str, float] | None = None
    ) -> bool:
        """Let ``source`` refer to ``target``; False where it does already. Both count as changed (rev)."""
        return bool(self.link_many([Tie(source, kind, target, why, scores or {})]))

    def link_many(self, ties: Sequence[Tie]) -> list[Link]:
        """The same for many, faster; those that were not there already."""
        chain = self._chain
        ends = {end for tie in ties for end in (tie.source, tie.target)}
        sound = chain.written | {record.id for record in self.records(ids=ends - chain.written)}
        known = {
            (x.source, x.kind, x.target) for x in chain.view.links(self.bank, {tie.source for tie in ties})
        }
        made: dict[tuple[str, str, str], Tie] = {}
        for tie in ties:
            if tie.source == tie.target or not tie.kind or not {tie.source, tie.target} <= sound:
                raise MemoryStoreError(
                    f"Cannot link '{tie.source}' to '{tie.target}' as '{tie.kind}': two different records of bank "
                    f"'{self.bank}' and a kind are needed."
                )
            key = (tie.source, clean(tie.kind, 64), tie.target)
            if key not in known:
                made.setdefault(key, tie)
        if made:
            columns = ("bank", "source", "kind", "target", "at")
            rows = [dict(zip(columns, (self.bank, *key, self.now), strict=True)) for key in made]
            with chain.whole():
                chain.sql.execute(insert(LINK), rows)
                chain.touch({end for source, _, target in made for end in (source, target)} - chain.written)
        for (source, kind, target), tie in made.items():
            chain.event(f"link:{kind}", source, target, why=tie.why, scores=tie.scores)
        return [Link(*key, self.now) for key in made]

    def unlink(
        self, source: str, kind: str, target: str, *, why: str = "", scores: Mapping[str, float] | None = None
    ) -> bool:
        """Take a link away; False where there is none. Both ends count as changed (rev)."""
        link = (LINK.c.source == source) & (LINK.c.kind == kind) & (LINK.c.target == target)
        gone = self._chain.sql.execute(delete(LINK).where(LINK.c.bank == self.bank, link)).rowcount
        if gone:
            self._chain.touch([source, target])
            self._chain.event(f"unlink:{kind}", source, target, why=why, scores=scores)
        return bool(gone)

    def decide(
        self, action: str, record: str = "", *, why: str = "", scores: Mapping[str, float] | None = None
    ) -> None:
        """An event for a decision that changes no row (a lesson was discarded, a pass of governance was made)."""
        self._chain.check_action(action)
        self._chain.event(action, clean(record, 200), why=why, scores=scores)

    def save_episode(self, episode: StoredEpisode) -> None:
        """Keep an episode for replay, in place of what is stored for its source; its digest goes on the chain."""
        self.save_episodes([episode])

    def save_episodes(self, episodes: Iterable[StoredEpisode]) -> None:
        """The same for many, faster."""
        rows: dict[str, dict[str, object]] = {}
        taught: set[tuple[str, str]] = set()
        for episode in episodes:
            source = clean(episode.source, 200)
            if not source or not math.isfinite(episode.at):
                raise MemoryStoreError("An episode can be stored under a source and with a finite time only.")
            try:
                data = episode.to_json()
            except (ValueError, TypeError, RecursionError) as error:
                raise MemoryStoreError(f"The episode '{source}' is no sound JSON: {error}.") from error
            name = f"episode-{os.urandom(8).hex()}"
            rows[source] = {
                "bank": self.bank,
                "source": source,
                "name": name,
                "at": float(episode.at),
                "data": data,
            }
            taught |= {(record, source) for record in episode.records}
        if not rows:
            return
        chain = self._chain
        for stored in chain.view.episode_rows(self.bank, rows):
            rows[stored.source]["name"] = stored.name  # it stays
        with chain.whole():
            chain.sql.execute(upsert(chain.sql, EPISODE, ("bank", "source")), list(rows.values()))
            chain.delete(TAUGHT, "source", rows)
            if taught:
                pairs = [
                    {"bank": self.bank, "record": record, "source": source}
                    for record, source in sorted(taught)
                ]
                chain.sql.execute(insert(TAUGHT), pairs)
        for source, row in rows.items():
            digest = episode_digest(float(str(row["at"])), str(row["data"]))
            chain.event("episode", str(row["name"]), change=dump({"episode": digest, "source": source}))

    # Forgetting and repair ----------------------------------------------------------------------------------------

    def forget(self, id: str, *, why: str = "") -> bool:
        """Forget a record for good: row, vector, links, its episodes' text, and what events say of it.

        Its id, and the fact that it was forgotten, stay. Summaries that tell it go with it, and what others took
        over from it (:attr:`also` tells). After the commit, the store sees to it that no byte is left in the
        database's files. False where there is no such record.
        """
        return bool(self.forget_many([id], why=why))

    def forget_many(self, ids: Collection[str], *, why: str = "") -> list[str]:
        """The same for many, faster; the ids of those that were there."""
        return forget_many(self._chain, ids, why, self._done)

    @property
    def forgotten(self) -> list[str]:
        """Ids of the records that were forgotten, and of the summaries that told them."""
        return self._done.ids

    @property
    def also(self) -> list[str]:
        """Sentences on what else forgetting changed."""
        return self._done.also

    @property
    def to_scrub(self) -> bool:
        """Whether the files have to be cleaned after the commit."""
        return self._done.to_scrub

    def repair(self, vectors: Collection[str] = ()) -> Repaired:
        """Make rows, vectors and links that were changed behind the bank's back what its events say.

        Rows that no event created are forgotten; damaged vectors, and those of the ids in ``vectors``, are made again
        when the bank is asked next. What was stored of episodes cannot be had again. Raises
        :class:`MemoryStoreError` where the events were changed, too.
        """
        return repair(self._chain, vectors, self._done)

    def finish(self) -> None:
        """Advance the head of the chain, if anything happened; the last thing before the commit."""
        self._chain.finish()
