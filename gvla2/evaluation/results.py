"""The results database: what was measured, with which configuration, seed, code and versions.

SQLite by default, or PostgreSQL. A run is one call of a benchmark; a row is one cell of its design. A row's key covers
everything that could change its numbers, among them a digest of the code, so a stored cell need not be measured again.
"""

from __future__ import annotations

import hashlib
import json
import platform
import sys
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

from sqlalchemy import Engine, Text, create_engine
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import DBAPIError, SQLAlchemyError
from sqlalchemy.orm import registry
from sqlmodel import Field, Session, SQLModel, col, select

from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.io.database_url import Closing, parsed, shown
from gvla2.record.origin import commit

DEFAULT_URL = "sqlite:///outputs/results.sqlite"
BUSY_SECONDS = 30.0
PACKAGES = ("gvla2", "numpy", "scipy", "numba", "scikit-image", "trimesh", "sqlmodel", "torch")

tables = registry()


class ResultTables(SQLModel, registry=tables):
    """Keeps these tables apart from any other SQLModel table of the same process."""


class Run(ResultTables, table=True):
    """One call of a benchmark. ``started`` is UTC in ISO form; ``config`` YAML; ``versions`` JSON."""

    __tablename__: ClassVar[Any] = "bench_run"

    id: int | None = Field(default=None, primary_key=True)
    suite: str = Field(index=True)
    started: str
    folder: str = ""
    commit: str = ""
    code: str = ""
    config: str = Field(default="", sa_type=Text)
    versions: str = Field(default="{}", sa_type=Text)


class Row(ResultTables, table=True):
    """One measured cell: ``factors`` (object, seed, ...) and ``measures`` (numbers or null), both JSON.

    ``notes`` (JSON) holds the rest: the status of stages, the points of a Chamfer distance, an error.
    """

    __tablename__: ClassVar[Any] = "bench_row"

    key: str = Field(primary_key=True)
    run_id: int = Field(foreign_key="bench_run.id", index=True)
    suite: str = Field(index=True)
    factors: str = Field(sa_type=Text)
    measures: str = Field(sa_type=Text)
    notes: str = Field(default="{}", sa_type=Text)


@dataclass(frozen=True)
class Cell:
    """A row as the rest of the program sees it. A missing measure is None, never a number."""

    key: str
    factors: Mapping[str, str | int]
    measures: Mapping[str, float | None]
    notes: Mapping[str, Any]
    run: int = 0

    @property
    def status(self) -> str:
        """``ok``, or why it could not be measured."""
        return str(self.notes.get("status", "ok"))

    def texts(self, *names: str) -> tuple[str, ...]:
        """The factors of these names as text, "" for one that it does not have."""
        return tuple(str(self.factors.get(name, "")) for name in names)

    def flat(self) -> dict[str, Any]:
        """Factors, measures and notes side by side, as in ``result.json``."""
        return {**self.factors, **self.measures, **self.notes}


def latest(cells: Iterable[Cell], place: Callable[[Cell], Hashable]) -> list[Cell]:
    """One cell for each place: if it was measured twice, the later run's."""
    return list({place(cell): cell for cell in sorted(cells, key=lambda cell: cell.run)}.values())


def grouped(cells: Iterable[Cell], *names: str) -> dict[tuple[str, ...], list[Cell]]:
    """The cells by these factors, in order of first appearance."""
    groups: dict[tuple[str, ...], list[Cell]] = {}
    for cell in cells:
        groups.setdefault(cell.texts(*names), []).append(cell)
    return groups


def measured(cells: Iterable[Cell], name: str) -> list[float]:
    """The values of a measure, without the missing ones."""
    return [float(value) for cell in cells if (value := cell.measures.get(name)) is not None]


def cell_key(suite: str, *parts: object) -> str:
    """The key of a cell: a digest of everything that could change its numbers; parts must be JSON."""
    text = json.dumps([suite, *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


class Results(Closing):
    """An open results database. Every method raises :class:`Gvla2Error` when the database cannot be used."""

    def __init__(self, engine: Engine, url: str) -> None:
        self._engine = engine
        self.url = url

    @classmethod
    def open(cls, url: str = DEFAULT_URL) -> Results:
        """Open, or create, a database; raises :class:`ConfigurationError` for an invalid address."""
        where = parsed(url)
        connect = {"timeout": BUSY_SECONDS} if where.drivername == "sqlite" else {}
        try:
            engine = create_engine(where, connect_args=connect)
        except ImportError as error:
            raise ConfigurationError(
                f"results.url is '{shown(url)}', whose driver is missing ({error}): pip install 'gvla2[postgres]'."
            ) from error
        opened = cls(engine, shown(url))
        with opened._explained():
            path = file_of(url)
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
            try:
                tables.metadata.create_all(engine)
            except DBAPIError:  # another bench made them meanwhile
                tables.metadata.create_all(engine)
        return opened

    def begin(self, suite: str, folder: Path, config: str, code: str = "") -> int:
        """Record the start of a run with this configuration (YAML) and code (a digest); returns its number."""
        run = Run(
            suite=suite,
            started=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            folder=str(folder.absolute()),
            commit=commit(),
            code=code,
            config=config,
            versions=json.dumps(versions()),
        )
        with self._session() as session:
            session.add(run)
            session.flush()
            assert run.id is not None
            return run.id

    def add(self, run: int, suite: str, cells: Iterable[Cell]) -> None:
        """Store cells of a run, all or none; one with the same key, perhaps of another bench's, is replaced."""
        insert: Any = sqlite.insert if self._engine.dialect.name == "sqlite" else postgresql.insert
        own = ("factors", "measures", "notes")
        with self._session() as session:
            for cell in cells:
                texts = {name: json.dumps(dict(getattr(cell, name))) for name in own}
                values = {"run_id": run, "suite": suite, **texts}
                statement = insert(Row).values(key=cell.key, **values)
                session.execute(statement.on_conflict_do_update(index_elements=["key"], set_=values))

    def with_keys(self, keys: Sequence[str]) -> dict[str, Cell]:
        """The stored cells among these keys."""
        found: dict[str, Cell] = {}
        with self._session() as session:
            for start in range(0, len(keys), 500):  # databases limit the number of parameters
                query = select(Row).where(col(Row.key).in_(keys[start : start + 500]))
                found |= {row.key: _cell(row) for row in session.exec(query)}
        return found

    def cells(
        self,
        suite: str,
        where: Mapping[str, Sequence[str | int]] | None = None,
        runs: Sequence[int] = (),
    ) -> list[Cell]:
        """Cells of a suite whose factors have one of the given values, from these runs (default: all)."""
        query = select(Row).where(Row.suite == suite).order_by(col(Row.run_id), col(Row.key))
        if runs:
            query = query.where(col(Row.run_id).in_(list(runs)))
        with self._session() as session:
            cells = [_cell(row) for row in session.exec(query)]
        wanted = {name: {str(value) for value in values} for name, values in (where or {}).items()}
        return [c for c in cells if all(str(c.factors.get(n)) in values for n, values in wanted.items())]

    def runs(self, suite: str) -> list[Run]:
        """All runs of a suite, oldest first."""
        with self._session() as session:
            return list(session.exec(select(Run).where(Run.suite == suite).order_by(col(Run.id))))

    def close(self) -> None:
        """Release the database; safe to call twice."""
        self._engine.dispose()

    @contextmanager
    def _session(self) -> Iterator[Session]:
        with self._explained(), Session(self._engine, expire_on_commit=False) as session, session.begin():
            yield session

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (SQLAlchemyError, OSError) as error:
            cause = getattr(error, "orig", None) or error
            raise Gvla2Error(
                f"The results database {self.url} cannot be used: {cause}. Choose another with results.url=..."
            ) from error


def file_of(url: str) -> Path | None:
    """The file of a SQLite database; None for PostgreSQL."""
    where = parsed(url)
    return Path(str(where.database)) if where.drivername == "sqlite" else None


def _cell(row: Row) -> Cell:
    try:
        factors, measures, notes = map(json.loads, (row.factors, row.measures, row.notes))
    except json.JSONDecodeError as error:
        raise Gvla2Error(f"A row of the results database is damaged (key {row.key}): {error}") from error
    return Cell(row.key, factors, measures, notes, row.run_id)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that measurements depend on; absent ones are left out."""
    found = {"python": platform.python_version(), "platform": sys.platform}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


@cache
def code_digest(packages: tuple[str, ...]) -> str:
    """Hexadecimal digest of the Python files of packages: rows measured by other code are not mistaken for these.

    Unlike a commit it also covers uncommitted changes. A missing package counts as empty.
    """
    digest = hashlib.sha256()
    for package in packages:
        try:
            spec = find_spec(package)
        except ImportError:
            continue
        folders = (spec and spec.submodule_search_locations) or ()
        files = sorted(path for folder in folders for path in Path(folder).rglob("*.py"))
        for path in files or ([Path(spec.origin)] if spec and spec.origin else []):
            digest.update(f"{package}|{path.name}|".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
