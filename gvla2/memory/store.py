"""The bank's rows in SQL: transactions that are whole or nothing, safe among processes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType

from sqlalchemy import Engine, func
from sqlmodel import Session, col, select

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import LifecycleState
from gvla2.memory.records import Record
from gvla2.memory.sqlite import WRITES, database_path, explained, make_engine, prepare


class Store:
    """An open database of records. Any number of processes may have the same one open.

    Every method raises :class:`MemoryStoreError` when the database cannot be used.
    """

    def __init__(self, engine: Engine, url: str) -> None:
        self._engine: Engine | None = engine
        self._path = database_path(url)
        self.url = url

    @classmethod
    def open(cls, url: str, *, busy_seconds: float = 5.0) -> Store:
        """Open, or create, the database at ``sqlite:///path``, waiting for others at most ``busy_seconds``."""
        path = database_path(url)
        prepare(path, busy_seconds)
        return cls(make_engine(path, busy_seconds), url)

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A consistent view of the database; rows may be kept after it ends."""
        with self._session(writes=False) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """A transaction that holds the write lock from its start; any exception, Ctrl-C too, undoes all of it."""
        with self._session(writes=True) as session:
            yield session

    @contextmanager
    def _session(self, *, writes: bool) -> Iterator[Session]:
        if self._engine is None:
            raise MemoryStoreError(f"The memory {self._path} was closed.")
        bind = self._engine.execution_options(**{WRITES: writes})
        with explained(self._path), Session(bind, expire_on_commit=False) as session, session.begin():
            session.connection()  # takes the lock now, not at the first statement
            yield session

    def records(self, bank: str, states: Sequence[LifecycleState] | None = None) -> list[Record]:
        """The bank's records in these states (all by default), by id."""
        query = select(Record).where(Record.bank == bank).order_by(Record.id)
        if states is not None:
            query = query.where(col(Record.state).in_(states))
        with self.reading() as session:
            return list(session.exec(query))

    def close(self) -> None:
        """Release the database; safe to call twice."""
        if self._engine is not None:
            self._engine.dispose()
            self._engine = None

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def find(session: Session, bank: str, dedup_key: str) -> Record | None:
    """The record of a bank that says the same, if there is one."""
    return session.exec(select(Record).where(Record.bank == bank, Record.dedup_key == dedup_key)).first()


def next_rev(session: Session, bank: str) -> int:
    """The number of the bank's next change; call it inside ``writing`` alone."""
    latest = session.exec(select(func.max(Record.rev)).where(Record.bank == bank)).one()
    return (latest or 0) + 1
