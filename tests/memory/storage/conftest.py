"""Stores on SQLite and on a real PostgreSQL server (see `tests/conftest.py`), and records to put there."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gvla2.memory.records import Record
from gvla2.memory.store import Store

NOW = 1.8e9


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
                record, action, vector=vector, model="m" if vector is not None else "", **more
            )

    return put_


@pytest.fixture
def vector() -> np.ndarray:
    return np.linspace(-1, 1, 16, dtype=np.float32)
