"""The database among processes: creation, concurrency, crashes, and files that must be left alone."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import ConfigurationError, MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.store import Store
from gvla2_plugins.hash_embedder.embedder import HashEmbedder
from gvla2_plugins.hybrid import HybridConfig
from gvla2_plugins.hybrid.retriever import HybridRetriever

SUCCESS = Verdict.from_criteria({"task_completion": 1.0})
Open = Callable[..., Any]


def write(url: str, name: str, count: int) -> None:
    """Learn ``count`` lessons one by one, saying each id aloud after it was acknowledged."""
    bank = KnowledgeBank.open(
        url, retriever=HybridRetriever(HybridConfig()), embedder=HashEmbedder(), busy_seconds=30
    )
    with bank:
        for i in range(count):
            lessons = (Lesson("tool_usage", f"{name} lesson {i}"), Lesson("tool_usage", "said by all"))
            learned = bank.learn(MemoryEpisode(MemoryTask("q"), lessons, source=f"{name}/{i}"), SUCCESS)
            print(" ".join(learned.added + learned.merged), flush=True)


PROGRAM = (
    "import runpy, sys; runpy.run_path(sys.argv[1])['write'](sys.argv[2], sys.argv[3], int(sys.argv[4]))"
)
"""Runs ``write`` in another process by this file's path: tests are no package that could be imported there."""


def writer_of(url: str, name: str, count: int, stdout: int) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, __file__, url, name, str(count)], stdout=stdout, text=True
    )


def test_two_processes_create_and_fill_a_new_bank_at_once(url: str) -> None:
    writers = [writer_of(url, name, 50, subprocess.DEVNULL) for name in "ab"]
    assert [w.wait(60) for w in writers] == [0, 0]
    with Store.open(url) as store:
        records = store.records("default")
    shared = [r for r in records if r.content == "said by all"]
    assert {r.content for r in records} - {"said by all"} == {
        f"{n} lesson {i}" for n in "ab" for i in range(50)
    }
    assert [r.count for r in shared] == [100]  # no update was lost either
    assert len({r.rev for r in records}) == len(records)


def test_what_was_acknowledged_survives_kill_9(url: str) -> None:
    acknowledged: set[str] = set()
    for round_ in range(2):
        process = writer_of(url, f"round{round_}", 100000, subprocess.PIPE)
        assert process.stdout is not None
        for line in process.stdout:
            acknowledged |= set(line.split())
            if len(acknowledged) > 15 * (round_ + 1):
                break
        os.kill(process.pid, signal.SIGKILL)
        acknowledged |= set(process.stdout.read().rpartition("\n")[0].split())
        process.wait(10)
        process.stdout.close()
    with Store.open(url) as store:
        stored = {r.id for r in store.records("default")}
    assert len(acknowledged) > 30
    assert acknowledged <= stored


def spoil(path: Path, how: str) -> None:
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
    elif how == "stateless":
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("DELETE FROM memory_meta")
    elif how == "torn":
        data = bytearray(path.read_bytes())
        data[4096:] = os.urandom(len(data) - 4096)
        path.write_bytes(data)
    elif how == "rotten":  # one page of a file that looks well from outside
        bank = KnowledgeBank.open(
            f"sqlite:///{path}", retriever=HybridRetriever(HybridConfig()), embedder=HashEmbedder()
        )
        with bank:
            lessons = tuple(Lesson("tool_usage", f"lesson {i}") for i in range(16))
            bank.learn(MemoryEpisode(MemoryTask("q"), lessons), SUCCESS)
        data = bytearray(path.read_bytes())
        page = data.rindex(b"lesson 7") // 4096 * 4096
        data[page : page + 200] = b"\xff" * 200
        path.write_bytes(data)
    elif how == "read-only":
        path.chmod(0o444)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("garbage", "not a database"),
        ("foreign", "something else"),
        ("newer", "schema 99"),
        ("stateless", "damaged"),
        ("torn", "corrupt|malformed"),
        ("rotten", "corrupt|malformed"),
        ("read-only", "read-only"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_and_left_alone(tmp_path: Path, how: str, said: str) -> None:
    path = tmp_path / "memory.db"
    spoil(path, how)
    before, mode = path.read_bytes(), path.stat().st_mode
    beside = sorted(tmp_path.iterdir())
    with pytest.raises(MemoryStoreError, match=said) as caught:
        Store.open(f"sqlite:///{path}", busy_seconds=0.2)
    assert str(path) in str(caught.value)
    assert (path.read_bytes(), path.stat().st_mode) == (before, mode)
    assert sorted(tmp_path.iterdir()) == beside


def test_a_folder_in_place_of_the_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MemoryStoreError, match="cannot be used: it is a folder"):
        Store.open(f"sqlite:///{tmp_path}")


def test_a_locked_database_is_refused_and_serves_again_later(url: str, tmp_path: Path) -> None:
    Store.open(url).close()
    path = tmp_path / "memory.db"
    before = path.read_bytes()
    with closing(sqlite3.connect(path)) as holder:
        holder.execute("PRAGMA locking_mode=EXCLUSIVE")
        holder.execute("BEGIN EXCLUSIVE")
        started = time.monotonic()
        with pytest.raises(MemoryStoreError, match="locked"):
            Store.open(url, busy_seconds=0.2)
        assert time.monotonic() - started < 5
        assert path.read_bytes() == before
    with Store.open(url) as store:
        assert store.records("default") == []


def test_a_busy_writer_blocks_writers_but_no_readers(url: str, tmp_path: Path) -> None:
    with (
        Store.open(url, busy_seconds=0.2) as store,
        closing(sqlite3.connect(tmp_path / "memory.db")) as holder,
    ):
        holder.execute("BEGIN IMMEDIATE")
        assert store.records("default") == []
        with pytest.raises(MemoryStoreError, match="locked"), store.writing():
            pass
        holder.rollback()
        with store.writing():
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
        assert connection.execute("SELECT value FROM memory_meta WHERE key = 'schema'").fetchone() == ("1",)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(MemoryStoreError, match="cannot be used"):
        Store.open(f"sqlite:///{tmp_path / 'file' / 'memory.db'}")
    with pytest.raises(MemoryStoreError, match="cannot be used"):
        Store.open(f"sqlite:///{tmp_path}")


@pytest.mark.parametrize(
    "url", ["", "memory.db", "sqlite://", "sqlite:///:memory:", "postgresql://host/x", "nosuch:x"]
)
def test_other_addresses_are_errors_of_the_configuration(url: str) -> None:
    with pytest.raises(ConfigurationError, match="sqlite:///path"):
        Store.open(url)
