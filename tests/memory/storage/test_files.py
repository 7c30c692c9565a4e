"""SQLite files: created once, refused and left alone where they cannot be used, damaged rows kept apart."""

import os
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.tables import SCHEMA_VERSION
from tests.memory.looking import look

NOW = 1.8e9
Make = Callable[..., Record]


def spoil(path: Path, how: str, make: Make) -> None:
    if how == "garbage":
        path.write_bytes(b"this is no database, but it is somebody's data " * 200)
        return
    if how == "foreign":
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("CREATE TABLE photos (name TEXT)")
        return
    Store.open(f"sqlite:///{path}").close()
    if how == "newer":
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("UPDATE memory_meta SET value = '99'")
    elif how == "older":
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("UPDATE memory_meta SET value = '3'")
    elif how == "stateless":
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("DELETE FROM memory_meta")
    elif how == "torn":
        data = bytearray(path.read_bytes())
        data[4096:] = os.urandom(len(data) - 4096)
        path.write_bytes(data)
    elif how == "rotten":  # one page of a file that looks well from outside
        with Store.open(f"sqlite:///{path}") as store, store.writing("b", actor="a", now=NOW) as t:
            for i in range(16):
                t.put(make(f"r{i}", content=f"lesson {i}"), "add")
        data = bytearray(path.read_bytes())
        page = data.rindex(b"lesson 7") // 4096 * 4096
        data[page : page + 200] = b"\xff" * 200
        path.write_bytes(data)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("garbage", "not a database"),
        ("foreign", "another program"),
        ("newer", "schema 99"),
        ("older", "schema 3, and.*open it with the gvla2 that wrote it"),
        ("stateless", "schema None"),
        ("torn", "corrupt|malformed"),
        ("rotten", "corrupt|malformed"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_and_left_alone(
    tmp_path: Path, how: str, said: str, record: Make
) -> None:
    path = tmp_path / "memory.db"
    spoil(path, how, record)
    before, mode = path.read_bytes(), path.stat().st_mode
    beside = sorted(tmp_path.iterdir())
    with pytest.raises(MemoryStoreError, match=said) as caught:
        Store.open(f"sqlite:///{path}", busy_seconds=0.2)
    assert str(path) in str(caught.value)
    assert (path.read_bytes(), path.stat().st_mode) == (before, mode)
    assert sorted(tmp_path.iterdir()) == beside


def test_a_locked_database_is_refused_and_serves_again_later(sqlite_url: str, tmp_path: Path) -> None:
    Store.open(sqlite_url).close()
    path = tmp_path / "memory.db"
    before = path.read_bytes()
    with closing(sqlite3.connect(path)) as holder:
        holder.execute("PRAGMA locking_mode=EXCLUSIVE")
        holder.execute("BEGIN EXCLUSIVE")
        started = time.monotonic()
        with pytest.raises(MemoryStoreError, match="locked"):
            Store.open(sqlite_url, busy_seconds=0.2)
        assert time.monotonic() - started < 5
        assert path.read_bytes() == before
    with Store.open(sqlite_url) as store:
        assert look(store, "b").records() == []


def test_a_busy_writer_blocks_writers_but_no_readers(sqlite_url: str, tmp_path: Path) -> None:
    with (
        Store.open(sqlite_url, busy_seconds=0.2) as store,
        closing(sqlite3.connect(tmp_path / "memory.db")) as holder,
    ):
        holder.execute("BEGIN IMMEDIATE")
        assert look(store, "b").records() == []
        with pytest.raises(MemoryStoreError, match="locked"), store.writing("b", actor="a", now=NOW):
            pass
        holder.rollback()
        with store.writing("b", actor="a", now=NOW):
            pass


def test_an_empty_file_and_a_missing_folder_become_a_bank(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "er" / "memory.db"
    Store.open(f"sqlite:///{path}").close()
    assert path.exists()
    empty = tmp_path / "empty.db"
    empty.touch()
    Store.open(f"sqlite:///{empty}").close()
    with closing(sqlite3.connect(empty)) as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert connection.execute("SELECT value FROM memory_meta WHERE key = 'schema'").fetchone() == (
            str(SCHEMA_VERSION),
        )


@pytest.mark.parametrize(
    ("statement", "found"),
    [
        ("UPDATE memory SET effect = '{' WHERE id = '1'", "record 1: damaged: effect is not valid JSON"),
        (
            "UPDATE memory SET content = CAST(X'ff00ff' AS TEXT) WHERE id = '1'",
            "record 1: damaged: content of a",
        ),
        (
            "UPDATE memory SET confidence = 'high' WHERE id = '1'",
            "record 1: damaged: confidence of a wrong type",
        ),
    ],
)
def test_a_damaged_row_is_named_and_holds_up_nothing(
    sqlite_url: str, tmp_path: Path, record: Make, statement: str, found: str
) -> None:
    with Store.open(sqlite_url) as store:
        with store.writing("b", actor="a", now=NOW) as t:
            for i in range(3):
                t.put(record(str(i)), "add")
        with closing(sqlite3.connect(tmp_path / "memory.db")) as other, other:
            other.execute(statement)
        assert [r.id for r in look(store, "b").records()] == ["0", "2"]
        assert [c.record.id for c in look(store, "b").embedded(["active"])] == ["0", "2"]
        assert [str(p) for p in look(store, "b").verify() if str(p).startswith(found)]
        assert len(look(store, "b").verify()) == 1
        with store.writing("b", actor="a", now=NOW) as t:
            assert t.get("1") is None
            again = t.put(record("1", content="said again"), action="add")
        assert again.version == 2
        assert look(store, "b").verify() == []


@pytest.mark.parametrize("stored", [np.full(16, np.nan, "<f4").tobytes(), b"\x00" * 63])
def test_a_damaged_vector_is_left_out(
    sqlite_url: str, tmp_path: Path, record: Make, vector: np.ndarray, stored: bytes
) -> None:
    with Store.open(sqlite_url) as store:
        with store.writing("b", actor="a", now=NOW) as t:
            for i in range(3):
                t.put(record(str(i)), "add", vector=vector, model="m")
        with closing(sqlite3.connect(tmp_path / "memory.db")) as other, other:
            other.execute("UPDATE memory_vector SET vector = ? WHERE id = '1'", (stored,))
        assert [c.vector is None for c in look(store, "b").embedded(["active"])] == [False, True, False]


def test_threads_share_a_store(sqlite_url: str, record: Make) -> None:
    from concurrent.futures import ThreadPoolExecutor

    with Store.open(sqlite_url, busy_seconds=20) as store:

        def work(i: int) -> int:
            with store.writing("b", actor=f"thread {i}", now=NOW) as t:
                t.put(record(f"r{i}"), action="add")
            return store.rev("b")

        with ThreadPoolExecutor(6) as pool:
            revs = list(pool.map(work, range(40)))
        assert max(revs) == 40
        assert len(look(store, "b").records()) == 40
        assert look(store, "b").verify() == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_works_on_connections_of_its_own(sqlite_url: str, record: Make) -> None:
    with Store.open(sqlite_url) as store:
        assert store.rev("b") == 0
        child = os.fork()
        if child == 0:
            try:
                with store.writing("b", actor="child", now=NOW) as t:
                    t.put(record("c"), action="add")
                os._exit(0)
            finally:
                os._exit(1)
        assert os.waitpid(child, 0)[1] == 0
        assert [r.id for r in look(store, "b").records()] == ["c"]


@pytest.fixture
def filled(sqlite_url: str, tmp_path: Path) -> Path:
    with KnowledgeBank(sqlite_url) as bank:
        bank.admit("Lift the cup 15 cm.", task="lift the cup", trusted=True)
    return tmp_path / "memory.db"


def test_who_only_looks_makes_no_bank(tmp_path: Path, postgres_url: str) -> None:
    path = tmp_path / "deep" / "memory.db"
    with pytest.raises(MemoryStoreError, match=r"no memory in .* yet"):
        Store.open(f"sqlite:///{path}", create=False)
    assert not path.parent.exists()
    path.parent.mkdir()
    path.touch()
    with pytest.raises(MemoryStoreError, match=r"no memory in .* yet"):
        Store.open(f"sqlite:///{path}", create=False)
    assert path.read_bytes() == b""
    assert list(path.parent.iterdir()) == [path]
    with pytest.raises(MemoryStoreError, match="no memory in"):
        Store.open(postgres_url, create=False)
    Store.open(postgres_url).close()
    Store.open(postgres_url, create=False).close()


@pytest.mark.parametrize("how", ["deleted", "replaced"])
def test_a_file_that_is_taken_away_takes_nothing_in(
    filled: Path, sqlite_url: str, tmp_path: Path, how: str
) -> None:
    with KnowledgeBank(sqlite_url) as bank:
        bank.recall("cup")
        if how == "deleted":
            filled.unlink()
        else:
            Store.open(f"sqlite:///{tmp_path / 'other.db'}").close()
            (tmp_path / "other.db").replace(filled)
        for _ in range(2):
            with pytest.raises(MemoryStoreError, match=r"was deleted or replaced while it was open"):
                bank.admit("Close the lid.", task="close the lid", trusted=True)
    assert filled.exists() == (how == "replaced")
