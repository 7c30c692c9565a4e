"""Reading a bank: its valid rows at one instant."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Row, Select, func, select

from gvla2.errors import MemoryStoreError
from gvla2.memory.events import BANK, EPISODE, EVENT, LINK, RECORD, VECTOR, Event, Link, StoredEpisode
from gvla2.memory.records import COLUMNS, FORGOTTEN, Record, damage_of

Wanted = Collection[str] | None
"""Names to select; None for all."""
_STATE = COLUMNS.index("state")
_TOGETHER = 500
"""How many ids one query names, and how many rows of a stream are held at once."""


@dataclass(frozen=True, slots=True)
class RecordChange:
    """The present state of a record that a transaction after ``since`` changed (or a link of it).

    ``vector`` is (D,) float32 made by ``model``, read-only; None if damaged or missing (``model`` is then ""): the
    index then embeds the record. ``conflicts`` is how many others contradict the record. A record of the state
    :data:`FORGOTTEN` has an id, a version and a rev, and nothing else: drop it.
    """

    record: Record
    vector: NDArray[np.float32] | None
    model: str
    conflicts: int = 0


class BankView:
    """A bank at one instant. Damaged rows are skipped; :func:`~gvla2.memory.audit.audit` reports them."""

    def __init__(self, sql: Connection, bank: str) -> None:
        self.sql, self.bank = sql, bank

    @cached_property
    def head(self) -> Row[Any] | None:
        """The bank's own row (a damaged one raises). Its seq and hash, kept elsewhere, prove a whole chain."""
        row = self.sql.execute(select(BANK).where(BANK.c.bank == self.bank)).one_or_none()
        if row is not None and tuple(map(type, row)) != (str, int, int, str, float):
            raise MemoryStoreError(
                f"The bank '{self.bank}' has a damaged row: restore the database from a copy."
            )
        return row

    @property
    def rev(self) -> int:
        """The number of the bank's last transaction, 0 for none."""
        return int(self.head.rev) if self.head else 0

    def get(self, id: str) -> Record | None:
        """The record, None if it is missing, damaged or forgotten."""
        return next(iter(self.records(ids=[id])), None)

    def by_key(self, key: str) -> Record | None:
        """The record of a dedup key."""
        row = self.sql.execute(self._of(RECORD).where(RECORD.c.dedup_key == key)).one_or_none()
        return None if row is None else valid_record(row)

    def records(self, states: Wanted = None, ids: Wanted = None) -> list[Record]:
        """The records in these states, with these ids (all by default; never forgotten ones), by id."""
        found = [record for row in self.rows(states, ids) if (record := valid_record(row)) is not None]
        return sorted(found, key=lambda record: record.id)

    def rows(self, states: Wanted = None, ids: Wanted = None) -> Iterator[Row[Any]]:
        """The stored rows, damaged or not, including tombstones."""
        query = self._of(RECORD)
        query = query if states is None else query.where(RECORD.c.state.in_(states))
        return self._named(query, RECORD.c.id, ids)

    def changes(self, since: int = 0) -> list[RecordChange]:
        """Changes by transactions after ``since``, each record once, including forgotten ones."""
        joined = RECORD.outerjoin(VECTOR, (VECTOR.c.bank == RECORD.c.bank) & (VECTOR.c.id == RECORD.c.id))
        query, found = select(VECTOR.c.model, VECTOR.c.dimension, VECTOR.c.vector, RECORD), []
        query = query.select_from(joined).where(RECORD.c.bank == self.bank, RECORD.c.rev > since)
        for model, dimension, stored, *row in self.sql.execute(query):
            record = valid_record(row, forgotten=True)
            if record is not None:
                found.append((record, vector_of(dimension, stored), model or ""))
        against = self.conflicts({record.id for record, _, _ in found})
        return [RecordChange(record, vector, model, against[record.id]) for record, vector, model in found]

    def conflicts(self, ids: Set[str]) -> Counter[str]:
        """How many others contradict each of these records, in either direction of a link."""
        held = pairs_of(self.links(ids if len(ids) < 20 * _TOGETHER else None))["conflict"]
        return Counter(id for pair in held for id in pair if id in ids)

    def links(self, ids: Wanted = None) -> list[Link]:
        """The links of the bank, or those with one of these records at either end; by source, kind, target."""
        query = self._of(LINK, LINK.c.source, LINK.c.kind, LINK.c.target, LINK.c.at)
        ends = (LINK.c.source, LINK.c.target) if ids is not None else (LINK.c.source,)
        found = {tuple(row) for end in ends for row in self._named(query, end, ids)}
        return [Link(*row) for row in sorted(row for row in found if set(map(type, row[:3])) == {str})]

    def events(self, since: int = 0) -> Iterator[Event]:
        """The events with seq > ``since``, oldest first, a few at a time."""
        query = self._of(EVENT).where(EVENT.c.seq > since).order_by(EVENT.c.seq)
        return (Event(*tuple[Any, ...](row)) for row in self._named(query, EVENT.c.record, None))

    def history(self, id: str) -> list[Event]:
        """The events about one record, oldest first."""
        query = self._of(EVENT).where(EVENT.c.record == id).order_by(EVENT.c.seq)
        events = (Event(*tuple[Any, ...](row)) for row in self.sql.execute(query))
        return [event for event in events if not event.damage]

    def episodes(self, sources: Wanted = None) -> dict[str, StoredEpisode]:
        """The stored episodes by source, of these sources or all."""
        found = {}
        for row in self.episode_rows(sources):
            with suppress(ValueError):  # damaged: the audit reports it
                found[row.source] = StoredEpisode.from_json(row.source, row.at, row.data)
        return found

    def episode_rows(self, sources: Wanted = None) -> Iterator[Row[Any]]:
        """The rows of the stored episodes, damaged or not."""
        return self._named(self._of(EPISODE), EPISODE.c.source, sources)

    def counts(self) -> dict[str, Any]:
        """Numbers about the bank: records by state and type, counts of everything else, and the head of its chain."""
        tables = {"vectors": VECTOR, "links": LINK, "events": EVENT, "episodes": EPISODE}
        counted = {name: self.sql.scalar(self._of(table, func.count())) for name, table in tables.items()}
        for name, column in (("states", RECORD.c.state), ("types", RECORD.c.type)):
            query = self._of(RECORD, column, func.count()).group_by(column)
            counted[name] = {str(key): n for key, n in self.sql.execute(query) if key}
        seq, hash_ = (self.head.seq, self.head.hash) if self.head else (0, "")
        return {**counted, "rev": self.rev, "seq": seq, "hash": hash_}

    def _of(self, table: Any, *columns: Any) -> Select[Any]:
        """The bank's rows of a table, all columns or these."""
        return select(*columns or (table,)).where(table.c.bank == self.bank)

    def _named(self, query: Select[Any], column: Any, wanted: Wanted) -> Iterator[Row[Any]]:
        """The rows of a query, those whose ``column`` is among the ``wanted``, asked for a few at a time."""
        if wanted is None:
            options = {"stream_results": True, "max_row_buffer": _TOGETHER}
            yield from self.sql.execute(query, execution_options=options)
        for some in batches(wanted or ()):
            yield from self.sql.execute(query.where(column.in_(some))).all()


def pairs_of(links: Iterable[Link]) -> dict[str, set[tuple[str, str]]]:
    """The linked pairs of records by kind of link, in either direction.

    ``conflict``: they contradict each other; ``dismissed``: a judge found that they don't.
    """
    pairs: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for link in links:
        pairs[link.kind].add((min(link.source, link.target), max(link.source, link.target)))
    return pairs


def batches(values: Iterable[Any]) -> Iterator[list[Any]]:
    """Distinct values in order, as many at a time as one statement allows."""
    ordered = sorted(set(values), key=str)
    return (ordered[start : start + _TOGETHER] for start in range(0, len(ordered), _TOGETHER))


def valid_record(row: Sequence[Any], *, forgotten: bool = False) -> Record | None:
    """The record of a stored row; None for a damaged row, and for a tombstone unless ``forgotten``."""
    if (row[_STATE] == FORGOTTEN and not forgotten) or damage_of(tuple(row)):
        return None
    return Record(*row)


def vector_of(length: object, stored: object) -> NDArray[np.float32] | None:
    """The (D,) vector of stored bytes, None if they are damaged: wrong length, or not finite."""
    if not isinstance(stored, bytes) or not stored or type(length) is not int or len(stored) != 4 * length:
        return None
    vector = np.frombuffer(stored, dtype="<f4")
    return vector if np.isfinite(vector).all() else None
