"""What is PostgreSQL's own: locks, addresses, servers that are gone, and an extra that is not installed."""

import sys
import threading
from collections.abc import Callable

import psycopg
import pytest

from gvla2.errors import ConfigurationError, MemoryStoreError, MissingDependencyError
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from tests.memory.looking import look

NOW = 1.8e9
Make = Callable[..., Record]


def test_a_reader_that_has_seen_a_rev_has_seen_all_before_it(postgres_url: str, record: Make) -> None:
    """A plain sequence would let a later transaction become visible first, and the earlier one be missed."""
    with Store.open(postgres_url, busy_seconds=20) as store:
        seen: dict[str, int] = {}
        done = threading.Event()

        def poll() -> None:
            since = 0
            while not done.is_set() or store.rev("b") > since:
                with store.reading("b") as view:
                    records, since = view.records(), view.rev
                assert sorted(one.rev for one in records) == list(range(1, since + 1))
                seen.update({one.id: one.rev for one in records})

        def write(name: str) -> None:
            for i in range(40):
                with store.writing("b", actor=name, now=NOW) as t:
                    t.put(record(f"{name}{i}"), action="add")

        poller = threading.Thread(target=poll)
        writers = [threading.Thread(target=write, args=(name,)) for name in "xyz"]
        for thread in (poller, *writers):
            thread.start()
        for thread in writers:
            thread.join(60)
        done.set()
        poller.join(60)
        assert len(seen) == 120
        assert sorted(seen.values()) == list(range(1, 121))


def test_writers_of_one_bank_wait_and_those_of_others_do_not(postgres_url: str, record: Make) -> None:
    with Store.open(postgres_url) as first, Store.open(postgres_url, busy_seconds=0.2) as second:
        with first.writing("b", actor="a", now=NOW) as t:
            t.put(record("1"), action="add")
            assert look(second, "b").records() == []
            with second.writing("c", actor="a", now=NOW) as other:
                other.put(record("1", bank="c"), action="add")
            with (
                pytest.raises(MemoryStoreError, match="holds the lock"),
                second.writing("b", actor="a", now=NOW),
            ):
                pass
        assert [r.id for r in look(second, "b").records()] == ["1"]


def test_a_lost_connection_fails_once_and_is_replaced(postgres_url: str, record: Make) -> None:
    with Store.open(postgres_url) as store:
        with store.writing("b", actor="a", now=NOW) as t:
            t.put(record("1"), action="add")
        with psycopg.connect(postgres_url, autocommit=True) as other:
            others = (
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = current_database()"
            )
            other.execute(f"{others} AND pid <> pg_backend_pid()")
        with pytest.raises(MemoryStoreError, match="cannot be used"):
            store.rev("b")
        assert store.rev("b") == 1


def test_a_server_that_is_not_there_is_named_without_the_password() -> None:
    url = "postgresql://robot:hush@127.0.0.1:1/bank"
    with pytest.raises(MemoryStoreError, match=r"/bank cannot.*Is the server running") as caught:
        Store.open(url, busy_seconds=1)
    assert "hush" not in str(caught.value)
    with pytest.raises(ConfigurationError, match="postgresql://user@host/database"):
        Store.open("postgresql://[::bad/bank")


def test_later_and_foreign_tables_are_refused(postgres_url: str) -> None:
    Store.open(postgres_url).close()
    with psycopg.connect(postgres_url, autocommit=True) as other:
        other.execute("UPDATE memory_meta SET value = '99'")
        with pytest.raises(MemoryStoreError, match="schema 99"):
            Store.open(postgres_url)
        other.execute("DELETE FROM memory_meta")
        with pytest.raises(MemoryStoreError, match="schema None"):
            Store.open(postgres_url)
        other.execute("DROP TABLE memory_meta")
        with pytest.raises(MemoryStoreError, match="another program"):
            Store.open(postgres_url)


def test_the_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(MissingDependencyError, match=r"gvla2\[postgres\]"):
        Store.open("postgresql://user@host/bank")
