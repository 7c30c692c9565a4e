"""What the store asks of a database: connections that run SQL, in transactions that are whole or nothing.

SQL is written once, with ``?`` for values; :mod:`gvla2.memory.storage.sqlite` and
:mod:`gvla2.memory.storage.postgres` run it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

Row = tuple[Any, ...]

SCHEMA_VERSION = 2
"""Version of the tables, kept in ``memory_meta``; a later one is refused, an earlier one migrated."""


@dataclass(frozen=True, slots=True)
class Uncleaned:
    """A file that may hold bytes of what was forgotten ("" is the database's own), and how a message says so."""

    path: str
    said: str


class Connection(Protocol):
    """A connection inside a transaction."""

    def rows(self, sql: str, values: Sequence[Any] = ()) -> list[Row]:
        """All rows of a query."""
        ...

    def row(self, sql: str, values: Sequence[Any] = ()) -> Row | None:
        """The first row of a query, None where there is none."""
        ...

    def stream(self, sql: str, values: Sequence[Any] = ()) -> Iterator[Row]:
        """The rows of a query, a few at a time."""
        ...

    def run(self, sql: str, values: Sequence[Any] = ()) -> int:
        """Run a statement; how many rows it touched."""
        ...

    def run_many(self, sql: str, values: Iterable[Sequence[Any]]) -> None:
        """Run a statement once for each row of values."""
        ...


class Database(Protocol):
    """A database with the memory's tables. Every failure is a :class:`~gvla2.errors.MemoryStoreError`."""

    @property
    def name(self) -> str:
        """The file or address, as messages say it; without a password."""
        ...

    def reading(self) -> AbstractContextManager[Connection]:
        """A consistent view, held until the end of the block."""
        ...

    def writing(self, bank: str) -> AbstractContextManager[Connection]:
        """A transaction that keeps other writers of the bank out from its start; an exception undoes all of it."""
        ...

    def one(self, sql: str, values: Sequence[Any]) -> Row | None:
        """The first row of a query by itself, as cheaply as can be."""
        ...

    def scrub(self) -> None:
        """Overwrite what was deleted, so that no byte of it is left in the database's files; gives space back."""
        ...

    def forget_in_copies(self, gone: Callable[[], Sequence[tuple[str, str]]]) -> list[Uncleaned]:
        """Take records, (bank, id), out of the copies that a migration left beside the database.

        ``gone`` is asked only where there are copies. Those that could not be cleaned are returned.
        """
        ...

    def snapshot(self, path: Path) -> None:
        """Write a consistent copy, a SQLite file, in one step; an existing file is replaced."""
        ...

    def size(self) -> int:
        """Bytes on disk."""
        ...

    def close(self) -> None:
        """Close all connections; safe to call twice."""
        ...
