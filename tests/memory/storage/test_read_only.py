"""A bank that cannot be written can be read; one that is taken away while it is open takes nothing in."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, Verdict
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from tests.memory.looking import look

NOW = 1.8e9
GOOD = Verdict.from_criteria({"done": 1.0})
Make = Callable[..., Record]


@pytest.fixture
def filled(sqlite_url: str, tmp_path: Path) -> Path:
    with KnowledgeBank(sqlite_url) as bank:
        bank.admit(Lesson("procedural_hint", "Lift the cup 15 cm."), GOOD, task="lift the cup", trusted=True)
    return tmp_path / "memory.db"


def test_a_read_only_bank_is_read(filled: Path, sqlite_url: str, tmp_path: Path) -> None:
    filled.chmod(0o444)
    before, beside = filled.read_bytes(), sorted(tmp_path.iterdir())
    with KnowledgeBank(sqlite_url) as bank:
        (record,) = bank.records()
        assert bank.recall("lift the red cup").items
        assert [hit.record.id for hit in bank.search("cup")] == [record.id]
        assert bank.verify() == []
        assert look(bank.store, bank.bank).history(record.id)
        for change in (
            lambda: bank.admit(
                Lesson("procedural_hint", "Close the lid."), GOOD, task="close the lid", trusted=True
            ),
            lambda: bank.forget(record.id),
            bank.store.compact,
        ):
            with pytest.raises(MemoryStoreError, match=r"is read-only\. Make it writable"):
                change()
        assert bank.records() == [record]
    assert filled.read_bytes() == before
    assert sorted(tmp_path.iterdir()) == beside


def test_a_reader_sees_what_a_writer_has_in_its_log(filled: Path, sqlite_url: str) -> None:
    with KnowledgeBank(sqlite_url) as writer:
        writer.admit(Lesson("procedural_hint", "Close the lid."), GOOD, task="close the lid", trusted=True)
        filled.chmod(0o444)
        with Store.open(sqlite_url) as reader:
            assert len(look(reader, "default").records()) == 2


def test_a_read_only_bank_that_would_have_to_be_changed_first_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    path.touch()
    path.chmod(0o444)
    with pytest.raises(MemoryStoreError, match=r"is read-only.*It is empty"):
        Store.open(f"sqlite:///{path}")
    assert path.read_bytes() == b""


def test_who_only_looks_makes_no_bank(tmp_path: Path, postgres_url: str) -> None:
    path = tmp_path / "deep" / "memory.db"
    with pytest.raises(MemoryStoreError, match=r"no memory in .* yet: it is absent"):
        Store.open(f"sqlite:///{path}", create=False)
    assert not path.parent.exists()
    path.parent.mkdir()
    path.touch()
    with pytest.raises(MemoryStoreError, match=r"no memory in .* yet: it is empty"):
        Store.open(f"sqlite:///{path}", create=False)
    assert path.read_bytes() == b""
    assert list(path.parent.iterdir()) == [path]
    with pytest.raises(MemoryStoreError, match="it has no tables"):
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
                bank.admit(
                    Lesson("procedural_hint", "Close the lid."), GOOD, task="close the lid", trusted=True
                )
    assert filled.exists() == (how == "replaced")


def test_a_connection_never_brings_a_deleted_file_back(filled: Path, sqlite_url: str) -> None:
    with Store.open(sqlite_url) as store:
        filled.unlink()
        with pytest.raises(MemoryStoreError, match="unable to open database file"):
            look(store, "default").records()
    assert not filled.exists()


def test_devices_and_pipes_are_named(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in ("/dev/null", tmp_path / "pipe"):
        with pytest.raises(MemoryStoreError, match="it is a device or a pipe"):
            Store.open(f"sqlite:///{path}")


def test_a_clock_beyond_all_calendars_is_refused(store: Store, record: Make) -> None:
    for now in (1e300, -1e300, 253402300800.0):
        with (
            pytest.raises(MemoryStoreError, match="before the year 10000"),
            store.writing("b", actor="a", now=now),
        ):
            pass
    with store.writing("b", actor="a", now=253402300799.0) as t:
        t.put(record("1"), action="add")
    assert look(store, "b").verify() == []
