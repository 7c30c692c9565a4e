"""Which stored episodes taught a record, and by what names events speak of them: for one record, and for many."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from gvla2.memory.records import dump, load_object
from gvla2.memory.storage.database import Connection
from gvla2.memory.storage.view import View

_FEW = 8
"""Questions that are answered by the database, each by going through all episodes; then all are read once."""


class EpisodeLookup:
    """The episodes of one bank while a transaction forgets records; to be made anew when episodes were saved."""

    def __init__(self, sql: Connection, bank: str) -> None:
        self._sql, self._view, self._bank = sql, View(sql), bank
        self._asked = 0
        self._taught: dict[str, set[str]] | None = None
        self._unsound: list[tuple[str, str]] = []
        self._stored: set[str] = set()
        self._names: dict[str, set[str]] = defaultdict(set)

    def behind(self, id: str, listed: Iterable[str]) -> list[str]:
        """Sources of the stored episodes that taught a record: those it lists, and those that name it."""
        self._asked += 1
        if self._taught is None and self._asked <= _FEW:
            said = f"%{dump(id)}%".replace("\\", "\\\\").replace("_", "\\_")
            query = "SELECT source FROM memory_episode WHERE bank = ? AND data LIKE ? ESCAPE '\\'"
            named = {str(row[0]) for row in self._sql.rows(query, (self._bank, said))}
            return sorted(
                named | {row[0] for row in self._view.episode_rows(self._bank, sorted(set(listed)))}
            )
        taught = self._read()
        unsound = {source for source, data in self._unsound if dump(id) in data}
        return sorted((taught.get(id, set()) | unsound | set(listed)) & self._stored)

    def drop(self, source: str) -> None:
        """The episode is stored no more."""
        self._stored.discard(source)

    def names(self, source: str) -> list[str]:
        """See :meth:`View.episode_names`."""
        if self._taught is None:
            return self._view.episode_names(self._bank, source)
        return sorted(self._names.get(source, ()))

    def _read(self) -> dict[str, set[str]]:
        if self._taught is not None:
            return self._taught
        taught: dict[str, set[str]] = defaultdict(set)
        for source, data in self._sql.stream(
            "SELECT source, data FROM memory_episode WHERE bank = ?", (self._bank,)
        ):
            self._stored.add(source)
            try:
                for id in load_object(data)["records"]:
                    taught[str(id)].add(source)
            except (ValueError, TypeError, KeyError, RecursionError):
                self._unsound.append((source, str(data)))
        query = "SELECT record, change FROM memory_event WHERE bank = ? AND action = 'episode'"
        for name, change in self._sql.stream(query, (self._bank,)):
            try:
                source = load_object(change).get("source", name) if change else name
            except (ValueError, TypeError, RecursionError):
                source = name
            self._names[str(source)].add(name)
        self._taught = taught
        return taught
