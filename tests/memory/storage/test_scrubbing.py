"""Bytes that cannot be overwritten at once are named, stay noted, and go the next time; whichever file holds them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import update

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import Record
from gvla2.memory.storage.forgetting import PENDING
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.tables import META
from gvla2.memory.storage.writing import Put
from tests.memory.looking import look

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
        return [bool(t.forget(id)) for id in ids]


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
        assert not {"secret-1", "secret-2"} & {r.id for r in look(store, "b").records()}
        assert [p.where for p in look(store, "b").verify()] == ["file"]
        assert holders(tmp_path)
        assert forget(store, "secret-1") == [False]  # again: it is gone, and now its bytes are, too
        assert holders(tmp_path) == []
        assert look(store, "b").verify() == []


def test_a_disk_that_was_full_before(sqlite_url: str, tmp_path: Path, record: Make) -> None:
    with Store.open(sqlite_url) as store:
        fill(store, record)
        store.compact()
        with files_up_to(10), pytest.raises(MemoryStoreError, match="The change was not stored"):
            forget(store, "secret-1")
        assert "secret-1" in {r.id for r in look(store, "b").records()}
        assert forget(store, "secret-1") == [True]
        assert look(store, "b").verify() == []


def test_a_server_that_others_read_says_so_and_is_cleaned_later(postgres_url: str, record: Make) -> None:
    import psycopg

    with Store.open(postgres_url, busy_seconds=0.2) as store:
        fill(store, record)
        with psycopg.connect(postgres_url) as reader:
            reader.execute("SELECT COUNT(*) FROM memory").fetchone()
            with pytest.raises(MemoryStoreError, match=r"secret-1: forgotten.*lock timeout.*memory compact"):
                forget(store, "secret-1")
        assert [p.where for p in look(store, "b").verify()] == ["file"]
        store.compact()
        assert look(store, "b").verify() == []


def test_somebody_elses_forgetting_stays_noted(
    sqlite_url: str, record: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Store.open(sqlite_url) as store, Store.open(sqlite_url) as other:
        fill(store, record)
        clean = store._database.scrub

        def meanwhile() -> None:
            monkeypatch.setattr(store._database, "scrub", clean)
            with other._database.writing("b") as sql:  # as whoever forgets something notes it
                sql.execute(update(META).where(META.c.key == PENDING).values(value="another"))
            clean()

        monkeypatch.setattr(store._database, "scrub", meanwhile)
        forget(store, "secret-1")
        assert [p.where for p in look(store, "b").verify()] == [
            "file"
        ]  # who began before that clears nothing
        store.compact()
        assert look(store, "b").verify() == []


def test_a_link_to_the_file_is_the_file(tmp_path: Path, record: Make) -> None:
    (tmp_path / "real").mkdir()
    link = tmp_path / "link.db"
    link.symlink_to(tmp_path / "real" / "memory.db")
    with Store.open(f"sqlite:///{link}") as store:
        fill(store, record)
        assert store.name == str((tmp_path / "real" / "memory.db").resolve())
    with Store.open(tmp_path / "real" / "memory.db") as store:
        forget(store, "secret-1", "secret-2")
    assert holders(tmp_path) == []
