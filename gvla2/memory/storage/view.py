"""Reading a bank: rows that are sound, as they were at one instant."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Row, Select, func, select

from gvla2.memory.records import COLUMNS, FORGOTTEN, Record, damage_of, load_object
from gvla2.memory.storage.database import count_of, streamed
from gvla2.memory.storage.episodes import StoredEpisode
from gvla2.memory.storage.events import Event, Link
from gvla2.memory.storage.tables import BANK, EPISODE, EVENT, LINK, META, RECORD, VECTOR

_STATE = COLUMNS.index("state")
_CHUNK = 500
"""How many ids one query names."""
_MANY = 20 * _CHUNK
"""From so many ids on, those of a whole bank are counted at once."""


@dataclass(frozen=True, slots=True)
class Change:
    """A record as it is now, which a transaction after ``since`` changed (or a link of it).

    ``vector`` is (D,) float32 made by ``model``, read-only; None where it is damaged, or where there is none (``model``
    is "" then): the index embeds the record then. ``conflicts`` is how many others contradict the record. Where
    ``forgotten``, the record has an id, a version and a rev, and nothing else: drop it.
    """

    record: Record
    vector: NDArray[np.float32] | None
    model: str
    conflicts: int = 0

    @property
    def forgotten(self) -> bool:
        """Whether the record is to be dropped."""
        return self.record.state == FORGOTTEN


class View:
    """All banks of a database at one instant. Damaged rows are passed over; ``Store.verify`` names them."""

    def __init__(self, connection: Connection) -> None:
        self._sql = connection

    def banks(self) -> list[str]:
        """Names of the banks that anything was ever written to."""
        return sorted(self._sql.execute(select(BANK.c.bank)).scalars())

    def head(self, bank: str) -> Row[Any] | None:
        """The bank's own row. (rev, seq, hash), kept elsewhere, prove later that the end was not cut off."""
        return self._sql.execute(select(BANK).where(BANK.c.bank == bank)).one_or_none()

    def rev(self, bank: str) -> int:
        """The number of the bank's last transaction, 0 for none."""
        return int(self._sql.execute(select(BANK.c.rev).where(BANK.c.bank == bank)).scalar() or 0)

    def models(self, bank: str) -> dict[str, int]:
        """The length of the vectors of each embedding model; {} where that is damaged."""
        row = self.head(bank)
        try:
            return {name: int(length) for name, length in load_object(str(row.models)).items()} if row else {}
        except (ValueError, TypeError):
            return {}

    def model(self, bank: str) -> str:
        """The embedding model of a vector of the bank, "" where it has none."""
        query = select(VECTOR.c.model).where(VECTOR.c.bank == bank).limit(1)
        return str(self._sql.execute(query).scalar() or "")

    def meta(self, key: str) -> str:
        """A fact about the database itself, "" where it is not stated."""
        return str(self._sql.execute(select(META.c.value).where(META.c.key == key)).scalar() or "")

    # Records ------------------------------------------------------------------------------------------------------

    def get(self, bank: str, id: str) -> Record | None:
        """The record, None where there is none, or a damaged or forgotten one."""
        return next(iter(self.records(bank, ids=[id])), None)

    def by_keys(self, bank: str, keys: Collection[str]) -> dict[str, Record]:
        """The records of dedup keys, by key."""
        rows = self._chunked(select(RECORD).where(RECORD.c.bank == bank), RECORD.c.dedup_key, keys)
        return {record.dedup_key: record for row in rows if (record := sound(row)) is not None}

    def owners(self, bank: str, keys: Collection[str]) -> dict[str, str]:
        """Which rows have these dedup keys, damaged ones too: key by id."""
        query = select(RECORD.c.id, RECORD.c.dedup_key).where(RECORD.c.bank == bank)
        return {row.id: row.dedup_key for row in self._chunked(query, RECORD.c.dedup_key, keys)}

    def records(
        self, bank: str, states: Sequence[str] | None = None, ids: Collection[str] | None = None
    ) -> list[Record]:
        """The records in these states, with these ids (all by default; never forgotten ones), by id."""
        found = [record for row in self.rows(bank, states, ids) if (record := sound(row)) is not None]
        return sorted(found, key=lambda record: record.id)

    def rows(
        self, bank: str, states: Sequence[str] | None = None, ids: Collection[str] | None = None
    ) -> Iterator[Row[Any]]:
        """The stored rows, damaged or not, tombstones too."""
        query = select(RECORD).where(RECORD.c.bank == bank)
        if states is not None:
            query = query.where(RECORD.c.state.in_(states))
        yield from self._chunked(query, RECORD.c.id, ids)

    def changes(self, bank: str, since: int) -> list[Change]:
        """What transactions after ``since`` changed, each record once, by rev and id; forgotten ones too."""
        joined = RECORD.outerjoin(VECTOR, (VECTOR.c.bank == RECORD.c.bank) & (VECTOR.c.id == RECORD.c.id))
        query = select(VECTOR.c.model, VECTOR.c.dimension, VECTOR.c.vector, RECORD).select_from(joined)
        found = []
        for row in self._sql.execute(query.where(RECORD.c.bank == bank, RECORD.c.rev > since)):
            model, length, stored = row[0], row[1], row[2]
            record = sound(row[3:], forgotten=True)
            if record is not None:
                found.append((record, vector_of(length, stored), model or ""))
        found.sort(key=lambda entry: (entry[0].rev, entry[0].id))
        against = self.conflicts(bank, [entry[0].id for entry in found])
        return [Change(record, vector, model, against.get(record.id, 0)) for record, vector, model in found]

    def vector_rows(self, bank: str) -> Iterator[Row[Any]]:
        """(id, model, dimension, bytes, state of the record or None) of the stored vectors."""
        joined = VECTOR.outerjoin(RECORD, (VECTOR.c.bank == RECORD.c.bank) & (VECTOR.c.id == RECORD.c.id))
        columns = (VECTOR.c.id, VECTOR.c.model, VECTOR.c.dimension, VECTOR.c.vector, RECORD.c.state)
        yield from streamed(self._sql, select(*columns).select_from(joined).where(VECTOR.c.bank == bank))

    # Links --------------------------------------------------------------------------------------------------------

    def conflicts(self, bank: str, ids: Collection[str]) -> dict[str, int]:
        """How many others contradict each of these records, or are suspected of it and were not acquitted, whichever
        end a link names; those with none left out.
        """
        query = select(LINK.c.source, LINK.c.kind, LINK.c.target).where(LINK.c.bank == bank)
        query = query.where(LINK.c.kind.in_(("conflict", "suspicion", "dismissed")))
        few = ids if len(ids) <= _MANY else None
        rows = set(self._chunked(query, LINK.c.source, few))
        if few is not None:
            rows |= set(self._chunked(query, LINK.c.target, few))
        pairs: dict[str, set[frozenset[str]]] = {"conflict": set(), "suspicion": set(), "dismissed": set()}
        for row in rows:
            pairs[row.kind].add(frozenset((row.source, row.target)))
        wanted = set(ids)
        ends = [id for pair in pairs["conflict"] | (pairs["suspicion"] - pairs["dismissed"]) for id in pair]
        return dict(Counter(id for id in ends if id in wanted))

    def links(self, bank: str, ids: Collection[str] | None = None) -> list[Link]:
        """The links of the bank, or those that name one of these records on either end; by source, kind, target."""
        query = select(LINK.c.source, LINK.c.kind, LINK.c.target, LINK.c.at).where(LINK.c.bank == bank)
        rows = set(self._chunked(query, LINK.c.source, ids))
        if ids is not None:
            rows |= set(self._chunked(query, LINK.c.target, ids))
        return [Link(*row) for row in sorted(tuple[Any, ...](row) for row in rows)]

    # Events and episodes ------------------------------------------------------------------------------------------

    def events(self, bank: str, since: int = 0, limit: int | None = None) -> list[Event]:
        """The events with seq > ``since``, oldest first, at most ``limit``."""
        query = select(EVENT).where(EVENT.c.bank == bank, EVENT.c.seq > since)
        return [Event(*row) for row in self._sql.execute(query.order_by(EVENT.c.seq).limit(limit))]

    def stream_events(self, bank: str, until: float = math.inf) -> Iterator[Event]:
        """The events of a bank up to a time (seconds since the epoch), oldest first, a few at a time."""
        query = select(EVENT).where(EVENT.c.bank == bank)
        if until != math.inf:
            query = query.where(EVENT.c.at <= until)
        return (Event(*row) for row in streamed(self._sql, query.order_by(EVENT.c.seq)))

    def history(self, bank: str, id: str) -> list[Event]:
        """The events about one record (or one episode's source), oldest first."""
        named = select(EPISODE.c.name).where(EPISODE.c.bank == bank, EPISODE.c.source == id)
        names = [id, *self._sql.execute(named).scalars()]
        query = select(EVENT).where(EVENT.c.bank == bank, EVENT.c.record.in_(names))
        return [Event(*row) for row in self._sql.execute(query.order_by(EVENT.c.seq))]

    def decided(self, bank: str, action: str) -> set[str]:
        """Ids of the records that a decision of this name was made about."""
        query = select(EVENT.c.record).where(EVENT.c.bank == bank, EVENT.c.action == action)
        return set(self._sql.execute(query.distinct()).scalars())

    def origins(self, bank: str, ids: Collection[str]) -> dict[str, list[str]]:
        """Who brought the evidence behind each of these records, oldest first; those with none left out."""
        query = select(EVENT.c.record, EVENT.c.origin).where(EVENT.c.bank == bank, EVENT.c.origin != "")
        found: dict[str, list[str]] = {}
        for row in self._chunked(query.order_by(EVENT.c.seq), EVENT.c.record, ids):
            found.setdefault(row.record, []).append(row.origin)
        return found

    def episodes(self, bank: str, sources: Collection[str] | None = None) -> list[StoredEpisode]:
        """The stored episodes, of these sources or all, by time and source."""
        found = []
        for row in self.episode_rows(bank, sources):
            try:
                found.append(StoredEpisode.from_json(row.source, row.at, row.data))
            except (ValueError, TypeError, AttributeError, RecursionError):
                continue  # damaged: verify names it
        return sorted(found, key=lambda episode: (episode.at, episode.source))

    def episode_rows(self, bank: str, sources: Collection[str] | None = None) -> Iterator[Row[Any]]:
        """The rows of the stored episodes, damaged or not."""
        yield from self._chunked(select(EPISODE).where(EPISODE.c.bank == bank), EPISODE.c.source, sources)

    def counts(self, bank: str) -> dict[str, Any]:
        """Numbers about a bank."""
        grouped = {}
        for name in ("state", "type"):
            column = RECORD.c[name]
            query = select(column, func.count()).where(RECORD.c.bank == bank).group_by(column)
            if name == "type":
                query = query.where(RECORD.c.state != FORGOTTEN)
            grouped[f"{name}s"] = {str(key): int(n) for key, n in sorted(self._sql.execute(query).all())}
        tables = {"vectors": VECTOR, "links": LINK, "events": EVENT, "episodes": EPISODE}
        counted = {name: count_of(self._sql, table, bank) for name, table in tables.items()}
        head = self.head(bank)
        rev, seq, hash_ = (head.rev, head.seq, head.hash) if head else (0, 0, "")
        return {**grouped, **counted, "rev": rev, "seq": seq, "hash": hash_}

    def _chunked(self, query: Select[Any], column: Any, wanted: Collection[str] | None) -> Iterator[Row[Any]]:
        """The rows of a query, those whose ``column`` is among the ``wanted``, asked for a few at a time."""
        if wanted is None:
            yield from self._sql.execute(query)
            return
        ordered = sorted(set(wanted))
        for start in range(0, len(ordered), _CHUNK):
            yield from self._sql.execute(query.where(column.in_(ordered[start : start + _CHUNK]))).all()


def sound(row: Sequence[Any], *, forgotten: bool = False) -> Record | None:
    """The record of a stored row; None for a damaged row, and for a tombstone unless ``forgotten``."""
    if (row[_STATE] == FORGOTTEN and not forgotten) or damage_of(tuple(row)):
        return None
    return Record(*row)


def vector_of(length: object, stored: object) -> NDArray[np.float32] | None:
    """The (D,) vector of stored bytes, None where they are damaged: another length, or no finite numbers."""
    if not isinstance(stored, bytes) or not isinstance(length, int) or len(stored) != 4 * length:
        return None
    vector = np.frombuffer(stored, dtype="<f4")
    return vector if np.isfinite(vector).all() else None
