"""Bytes that cannot be overwritten at once are named, stay noted, and go the next time; whichever file holds them."""

import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError, OutputError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.forgetting.scrubbing import pending
from gvla2.memory.indexing.snapshot import FORMAT
from gvla2.memory.records import Record
from gvla2.memory.storage.location import snapshot_path
from gvla2.memory.storage.store import Put, Store

resource = pytest.importorskip("resource", reason="this system limits no files")
NOW = 1.8e9
SECRET = "the spare key is under the third flowerpot"
Make = Callable[..., Record]


def holders(folder: Path) -> list[str]:
    return [p.name for p in sorted(folder.rglob("*")) if p.is_file() and SECRET.encode() in p.read_bytes()]


def fill(store: Store, make: Make) -> None:
    with store.writing("b", actor="learn", now=NOW) as t:
        t.put_many([Put(make(f"r{i}", content=f"{i} " * 2000), "add") for i in range(30)])
        t.put_many([Put(make(id, content=f"{id}: {SECRET}"), "add") for id in ("secret-1", "secret-2")])


def forget(store: Store, *ids: str) -> list[bool]:
    with store.writing("b", actor="owner", now=NOW) as t:
        return [t.forget(id) for id in ids]


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """As on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_gets_full_meanwhile(sqlite_url: str, tmp_path: Path, record: Make) -> None:
    with Store.open(sqlite_url) as store:
        fill(store, record)
        store.compact()
        path = tmp_path / "memory.db"
        with files_up_to(path.stat().st_size // 2), pytest.raises(MemoryStoreError) as caught:
            forget(store, "secret-1", "secret-2")
        said = str(caught.value)
        assert said.startswith("secret-1, secret-2: forgotten, and no longer in the bank. Bytes")
        assert str(path) in said
        assert "gvla2 memory compact" in said
        assert "Nothing" not in said
        assert not {"secret-1", "secret-2"} & {r.id for r in store.records("b")}
        assert [p.where for p in store.verify("b")] == ["file"]
        assert holders(tmp_path)
        assert forget(store, "secret-1") == [False]  # again: it is gone, and now its bytes are, too
        assert holders(tmp_path) == []
        assert store.verify("b") == []


def test_a_disk_that_was_full_before(sqlite_url: str, tmp_path: Path, record: Make) -> None:
    with Store.open(sqlite_url) as store:
        fill(store, record)
        store.compact()
        with files_up_to(10), pytest.raises(MemoryStoreError, match="Nothing of the change was stored"):
            forget(store, "secret-1")
        assert "secret-1" in {r.id for r in store.records("b")}
        assert forget(store, "secret-1") == [True]
        assert store.verify("b") == []


def test_a_server_that_others_read_says_so_and_is_cleaned_later(postgres_url: str, record: Make) -> None:
    import psycopg

    with Store.open(postgres_url, busy_seconds=0.2) as store:
        fill(store, record)
        with psycopg.connect(postgres_url) as reader:
            reader.execute("SELECT COUNT(*) FROM memory").fetchone()
            with pytest.raises(MemoryStoreError, match=r"secret-1: forgotten.*lock timeout.*memory compact"):
                forget(store, "secret-1")
        assert [p.where for p in store.verify("b")] == ["file"]
        store.compact()
        assert store.verify("b") == []


def test_somebody_elses_forgetting_stays_noted(sqlite_url: str, record: Make) -> None:
    from gvla2.memory.forgetting import scrubbing

    with Store.open(sqlite_url) as store:
        fill(store, record)
        with store.reading() as view:
            before = view.meta(scrubbing.PENDING)
        forget(store, "secret-1")
        with store._database.writing("b") as sql:
            scrubbing.ask_for_scrubbing(sql)
        scrubbing._note(store._database, before, "")  # who began before that clears nothing
        assert [p.where for p in store.verify("b")] == ["file"]


def test_what_is_noted_may_be_of_an_earlier_version() -> None:
    assert pending("") == []
    assert pending("1") == [""]
    assert pending("{") == [""]
    assert pending('["token","","copy.db"]') == ["", "copy.db"]


# Kept indices -------------------------------------------------------------------------------------------------------


def test_half_written_indices_go_with_what_is_forgotten(
    sqlite_url: str, tmp_path: Path, record: Make
) -> None:
    with Store.open(sqlite_url) as store:
        fill(store, record)
        kept = snapshot_path(store.name, "b")
        stray = kept.with_name(f".{kept.name}.abc123")
        stray.write_text(SECRET)
        other = tmp_path / ".memory.db.index-of-mine"
        other.write_text("not the bank's")
        assert store.verify("b") == []  # somebody may be writing it just now
        forget(store, "secret-1", "secret-2")
        assert holders(tmp_path) == []
        assert other.exists()
        stray.write_text(SECRET)
        os.utime(stray, (1e9, 1e9))
        assert [(p.where, p.id) for p in store.verify("b")] == [("file", str(stray))]
        store.compact()
        assert not stray.exists()
        assert store.verify("b") == []


def test_a_link_to_the_file_is_the_file(tmp_path: Path, record: Make) -> None:
    (tmp_path / "real").mkdir()
    link = tmp_path / "link.db"
    link.symlink_to(tmp_path / "real" / "memory.db")
    with Store.open(f"sqlite:///{link}") as store:
        fill(store, record)
        assert store.name == str((tmp_path / "real" / "memory.db").resolve())
        snapshot_path(store.name, "b").write_text(SECRET)
    with Store.open(f"sqlite:///{tmp_path / 'real' / 'memory.db'}") as store:
        forget(store, "secret-1", "secret-2")
    assert holders(tmp_path) == []


def test_a_snapshot_never_takes_the_place_of_something_else(sqlite_url: str, tmp_path: Path) -> None:
    mine = tmp_path / "thesis.txt"
    mine.write_text("my only copy")
    with pytest.raises(OutputError, match="something else"):
        KnowledgeBank.open(sqlite_url, snapshot=mine)
    with KnowledgeBank.open(sqlite_url, snapshot=tmp_path / "index") as bank:
        (tmp_path / "index").write_text("put here meanwhile")
        bank.forget("nobody")
        assert (tmp_path / "index").read_text() == "put here meanwhile"
        (tmp_path / "index").write_text(f'{{"format": "{FORMAT}"')
        bank.forget("nobody")
        assert not (tmp_path / "index").exists()
    assert mine.read_text() == "my only copy"


# Copies beside it ---------------------------------------------------------------------------------------------------


def copy_with(path: Path, *ids: str) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE memory (id TEXT, bank TEXT, content TEXT)")
        connection.executemany(
            "INSERT INTO memory VALUES (?, 'b', ?)", [(id, f"{id} {SECRET}") for id in ids]
        )


@pytest.mark.parametrize(
    "half", [b"", b"torn " * 1000, b"SQLite format 3\x00" + b"\x10\x00\x02\x02" + b"\x00" * 80]
)
def test_half_a_copy_is_of_no_use_and_goes(
    sqlite_url: str, tmp_path: Path, record: Make, half: bytes
) -> None:
    with Store.open(sqlite_url) as store:
        fill(store, record)
        (tmp_path / "memory.db.before-schema-2").write_bytes(half)
        copy_with(tmp_path / "memory.db.before-schema-2.1", "secret-1", "secret-2", "r3")
        assert forget(store, "secret-1", "secret-2") == [True, True]
        assert not (tmp_path / "memory.db.before-schema-2").exists()
        left = (tmp_path / "memory.db.before-schema-2.1").read_bytes()
        assert b"secret-1" not in left
        assert b"r3" in left
        assert store.verify("b") == []


def test_a_copy_that_is_locked_is_named_and_cleaned_later(
    sqlite_url: str, tmp_path: Path, record: Make
) -> None:
    copy = tmp_path / "memory.db.before-schema-2"
    copy_with(copy, "secret-1")
    with Store.open(sqlite_url, busy_seconds=0.1) as store:
        fill(store, record)
        with closing(sqlite3.connect(copy, isolation_level=None)) as other:
            other.execute("BEGIN EXCLUSIVE")
            with pytest.raises(
                MemoryStoreError, match=r"secret-1, secret-2: forgotten.*before-schema-2 \(.*locked"
            ):
                forget(store, "secret-1", "secret-2")
            assert [(p.where, p.id) for p in store.verify("b")] == [("file", str(copy))]
            with pytest.raises(MemoryStoreError, match=r"before-schema-2 \(.*locked"):
                store.compact()
            assert store.verify("b") != []
            other.execute("ROLLBACK")
        assert holders(tmp_path) == [copy.name]
        store.compact()
        assert holders(tmp_path) == []
        assert store.verify("b") == []
