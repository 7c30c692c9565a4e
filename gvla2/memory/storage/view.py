"""Reading a bank: rows that are sound, as they were at one instant."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.records import COLUMNS, FORGOTTEN, Record, damage_of, dump, load_object
from gvla2.memory.storage.database import Connection, Row
from gvla2.memory.storage.episodes import StoredEpisode
from gvla2.memory.storage.events import EVENT_COLUMNS, Event, Link

_RECORD = ", ".join(f"m.{name}" for name in COLUMNS)
_EVENT = ", ".join(EVENT_COLUMNS)
_LINK = "SELECT source, kind, target, at FROM memory_link"
_CONFLICTS = (
    "SELECT id, COUNT(*) FROM (SELECT source AS id, target AS other FROM memory_link "
    "WHERE bank = ? AND kind = 'conflict' {} UNION SELECT target, source FROM memory_link "
    "WHERE bank || '' = ? AND kind = 'conflict' {}) AS named GROUP BY id"
)
_STATE = COLUMNS.index("state")
CHUNK = 500
"""How many ids one query names."""
MANY = 20 * CHUNK
"""From so many ids on, those of a whole bank are counted at once."""


@dataclass(frozen=True, slots=True)
class Change:
    """A record as it is now, which a transaction after ``since`` changed (or a link of it).

    ``vector`` is (D,) float32 made by ``model``, read-only; None where there is none, or a damaged one: the index
    embeds the record then. ``conflicts`` is how many others contradict the record. Where ``forgotten``, the record has
    an id, a version and a rev, and nothing else: drop it.
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
        return sorted(row[0] for row in self._sql.rows("SELECT bank FROM memory_bank"))

    def rev(self, bank: str) -> int:
        """The number of the bank's last transaction, 0 for none."""
        row = self._sql.row("SELECT rev FROM memory_bank WHERE bank = ?", (bank,))
        return int(row[0]) if row else 0

    def get(self, bank: str, id: str) -> Record | None:
        """The record, None where there is none, or a damaged or forgotten one."""
        row = self._sql.row(f"SELECT {_RECORD} FROM memory m WHERE m.bank = ? AND m.id = ?", (bank, id))
        return sound(row)

    def by_key(self, bank: str, dedup_key: str) -> Record | None:
        """The record that says the same, None where there is none."""
        row = self._sql.row(
            f"SELECT {_RECORD} FROM memory m WHERE m.bank = ? AND m.dedup_key = ?", (bank, dedup_key)
        )
        return sound(row)

    def by_keys(self, bank: str, keys: Sequence[str]) -> dict[str, Record]:
        """The records of many dedup keys, by key."""
        found: dict[str, Record] = {}
        for start in range(0, len(keys), CHUNK):
            some = keys[start : start + CHUNK]
            query = f"SELECT {_RECORD} FROM memory m WHERE m.bank = ? AND m.dedup_key IN ({_marks(some)})"
            for row in self._sql.rows(query, [bank, *some]):
                record = sound(row)
                if record is not None:
                    found[record.dedup_key] = record
        return found

    def records(
        self, bank: str, states: Sequence[str] | None = None, ids: Sequence[str] | None = None
    ) -> list[Record]:
        """The records in these states, with these ids (all by default; never forgotten ones), by id."""
        found = [record for row in self.rows(bank, states, ids) if (record := sound(row)) is not None]
        return sorted(found, key=lambda record: record.id)

    def rows(
        self, bank: str, states: Sequence[str] | None = None, ids: Sequence[str] | None = None
    ) -> Iterator[Row]:
        """The stored rows, damaged or not, tombstones too."""
        query, values = f"SELECT {_RECORD} FROM memory m WHERE m.bank = ?", [bank]
        if states is not None:
            if not states:
                return
            query, values = query + f" AND m.state IN ({_marks(states)})", [*values, *states]
        if ids is None:
            yield from self._sql.rows(query, values)
            return
        wanted = sorted(set(ids))
        for start in range(0, len(wanted), CHUNK):
            some = wanted[start : start + CHUNK]
            yield from self._sql.rows(f"{query} AND m.id IN ({_marks(some)})", [*values, *some])

    def changes(self, bank: str, since: int) -> list[Change]:
        """What transactions after ``since`` changed, each record once, by rev and id; forgotten ones too."""
        query = (
            f"SELECT v.model, v.dimension, v.vector, {_RECORD} FROM memory m "
            "LEFT JOIN memory_vector v ON v.bank = m.bank AND v.id = m.id WHERE m.bank = ? AND m.rev > ?"
        )
        found = []
        for model, dimension, stored, *row in self._sql.rows(query, (bank, since)):
            record = sound(tuple(row), forgotten=True)
            if record is not None:
                vector = vector_of(dimension, stored)
                found.append((record, vector, model if vector is not None else ""))
        found.sort(key=lambda entry: (entry[0].rev, entry[0].id))
        against = self.conflicts(bank, [entry[0].id for entry in found])
        return [Change(record, vector, model, against.get(record.id, 0)) for record, vector, model in found]

    def conflicts(self, bank: str, ids: Collection[str]) -> dict[str, int]:
        """How many others contradict each of these records, whichever end a link names; those with none left out.

        They are counted where they are stored: a much contradicted record has thousands.
        """
        if len(ids) > MANY:
            return dict(self._sql.rows(_CONFLICTS.format("", ""), (bank, bank)))
        found: dict[str, int] = {}
        wanted = sorted(set(ids))
        for start in range(0, len(wanted), CHUNK):
            some = wanted[start : start + CHUNK]
            query = _CONFLICTS.format(f"AND source IN ({_marks(some)})", f"AND target IN ({_marks(some)})")
            found |= dict(self._sql.rows(query, (bank, *some, bank, *some)))
        return found

    def links(self, bank: str, id: str | None = None) -> list[Link]:
        """The links of the bank, or those that name one record on either end; by source, kind and target."""
        if id is not None:
            # SQLite would look through all links of the bank by its primary key if it could use it for the target.
            query = f"{_LINK} WHERE bank = ? AND source = ? UNION {_LINK} WHERE bank || '' = ? AND target = ?"
            return _in_order(self._sql.rows(query, (bank, id, bank, id)))
        return _in_order(self._sql.rows(f"{_LINK} WHERE bank = ?", (bank,)))

    def events(self, bank: str, since: int = 0, limit: int | None = None) -> list[Event]:
        """The events with seq > ``since``, oldest first, at most ``limit``."""
        query, values = (
            f"SELECT {_EVENT} FROM memory_event WHERE bank = ? AND seq > ? ORDER BY seq",
            [bank, since],
        )
        if limit is not None:
            query, values = query + " LIMIT ?", [*values, limit]
        return [Event(*row) for row in self._sql.rows(query, values)]

    def stream_events(self, bank: str, until: float = math.inf) -> Iterator[Event]:
        """The events of a bank up to a time (seconds since the epoch), oldest first, a few at a time."""
        query, values = f"SELECT {_EVENT} FROM memory_event WHERE bank = ?", list[Any]([bank])
        if until != math.inf:
            query, values = query + " AND at <= ?", [*values, until]
        return (Event(*row) for row in self._sql.stream(query + " ORDER BY seq", values))

    def history(self, bank: str, id: str) -> list[Event]:
        """The events about one record (or one episode's source), oldest first."""
        record = self._sql.row("SELECT 1 FROM memory WHERE bank = ? AND id = ?", (bank, id))
        names = [id] if record else sorted({id, *self.episode_names(bank, id)})
        query = (
            f"SELECT {_EVENT} FROM memory_event WHERE bank = ? AND record IN ({_marks(names)}) ORDER BY seq"
        )
        return [Event(*row) for row in self._sql.rows(query, [bank, *names])]

    def episode_names(self, bank: str, source: str) -> list[str]:
        """By what names events speak of an episode: random ones, or its source itself in older banks."""
        said = dump({"source": source})[1:-1]
        like = "%" + re.sub(r"([\\%_])", r"\\\1", said) + "%"
        query = (
            "SELECT record, change FROM memory_event WHERE bank = ? AND action = 'episode' "
            "AND (record = ? OR change LIKE ? ESCAPE '\\')"
        )
        found = self._sql.rows(query, (bank, source, like))
        return sorted({name for name, change in found if name == source or said in change})

    def episodes(self, bank: str, sources: Sequence[str] | None = None) -> list[StoredEpisode]:
        """The stored episodes, of these sources or all, by time and source."""
        found = []
        for source, at, data in self.episode_rows(bank, sources):
            try:
                found.append(StoredEpisode.from_json(source, at, data))
            except (ValueError, TypeError, AttributeError, RecursionError):
                continue  # damaged: verify names it
        return sorted(found, key=lambda episode: (episode.at, episode.source))

    def episode_rows(self, bank: str, sources: Sequence[str] | None = None) -> Iterator[Row]:
        """(source, at, data) of the stored episodes, damaged or not."""
        query = "SELECT source, at, data FROM memory_episode WHERE bank = ?"
        if sources is None:
            yield from self._sql.rows(query, (bank,))
            return
        wanted = sorted(set(sources))
        for start in range(0, len(wanted), CHUNK):
            some = wanted[start : start + CHUNK]
            yield from self._sql.rows(f"{query} AND source IN ({_marks(some)})", [bank, *some])

    def head(self, bank: str) -> tuple[int, int, str] | None:
        """(rev, seq, hash) of the bank's last event: kept elsewhere, it proves later that the end was not cut off."""
        row = self._sql.row("SELECT rev, seq, hash FROM memory_bank WHERE bank = ?", (bank,))
        return (row[0], row[1], row[2]) if row else None

    def models(self, bank: str) -> dict[str, int]:
        """The dimension of the vectors of each embedding model; {} where that is damaged."""
        row = self._sql.row("SELECT models FROM memory_bank WHERE bank = ?", (bank,))
        return models_of(row[0]) if row else {}

    def vector_rows(self, bank: str) -> Iterator[Row]:
        """(id, model, dimension, bytes, whether a living record has that id) of the stored vectors."""
        query = (
            "SELECT v.id, v.model, v.dimension, v.vector, m.id IS NOT NULL AND m.state <> ? FROM memory_vector v "
            "LEFT JOIN memory m ON m.bank = v.bank AND m.id = v.id WHERE v.bank = ?"
        )
        return self._sql.stream(query, (FORGOTTEN, bank))

    def vectors_of(self, bank: str, ids: Sequence[str]) -> dict[str, tuple[object, object]]:
        """(dimension, bytes) of the stored vectors of these records, by id."""
        found: dict[str, tuple[object, object]] = {}
        for start in range(0, len(ids), CHUNK):
            some = ids[start : start + CHUNK]
            query = (
                f"SELECT id, dimension, vector FROM memory_vector WHERE bank = ? AND id IN ({_marks(some)})"
            )
            found |= {row[0]: (row[1], row[2]) for row in self._sql.rows(query, [bank, *some])}
        return found

    def meta(self, key: str) -> str:
        """A fact about the database itself, "" where it is not stated."""
        row = self._sql.row("SELECT value FROM memory_meta WHERE key = ?", (key,))
        return str(row[0]) if row else ""

    def counts(self, bank: str) -> dict[str, Any]:
        """Numbers about a bank."""
        states = self._sql.rows("SELECT state, COUNT(*) FROM memory WHERE bank = ? GROUP BY state", (bank,))
        types = self._sql.rows(
            "SELECT type, COUNT(*) FROM memory WHERE bank = ? AND state <> ? GROUP BY type", (bank, FORGOTTEN)
        )
        tables = ("memory_vector", "memory_link", "memory_event", "memory_episode")
        counted = {
            name.removeprefix("memory_") + "s": self._count(
                f"SELECT COUNT(*) FROM {name} WHERE bank = ?", bank
            )
            for name in tables
        }
        rev, seq, hash_ = self.head(bank) or (0, 0, "")
        head = {"rev": rev, "seq": seq, "hash": hash_}
        return {"states": dict(sorted(states)), "types": dict(sorted(types)), **counted, **head}

    def _count(self, query: str, bank: str) -> int:
        row = self._sql.row(query, (bank,))
        return int(row[0]) if row else 0


def sound(row: Row | None, *, forgotten: bool = False) -> Record | None:
    """The record of a stored row; None for a damaged row, and for a tombstone unless ``forgotten``."""
    if row is None or (row[_STATE] == FORGOTTEN and not forgotten) or damage_of(row):
        return None
    return Record(*row)


def vector_of(dimension: object, stored: object) -> NDArray[np.float32] | None:
    """The (D,) vector of stored bytes, None where they are damaged: another length, or no finite numbers."""
    if not isinstance(stored, bytes) or not isinstance(dimension, int) or len(stored) != 4 * dimension:
        return None
    vector = np.frombuffer(stored, dtype="<f4")
    return vector if np.isfinite(vector).all() else None


def models_of(text: object) -> dict[str, int]:
    """The dimension of the vectors of each embedding model, as ``memory_bank`` has it; {} where that is damaged."""
    try:
        return {name: int(dimension) for name, dimension in load_object(str(text)).items()}
    except (ValueError, TypeError):
        return {}


def _in_order(rows: Iterable[Row]) -> list[Link]:
    return sorted((Link(*row) for row in rows), key=lambda link: (link.source, link.kind, link.target))


def _marks(values: Sequence[object]) -> str:
    return ", ".join("?" * len(values))
