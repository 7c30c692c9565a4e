"""A database of schema 1 becomes one of today's: all of it, in one step, with a copy beside it."""

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.storage import migrations
from gvla2.memory.storage.store import Store

NOW = 1.8e9
SCHEMA_1 = """
CREATE TABLE memory_meta (key VARCHAR NOT NULL, value VARCHAR NOT NULL, PRIMARY KEY (key));
CREATE TABLE memory (
    id VARCHAR NOT NULL, bank VARCHAR NOT NULL, query TEXT NOT NULL, content TEXT NOT NULL, type VARCHAR NOT NULL,
    state VARCHAR NOT NULL, outcome VARCHAR NOT NULL, confidence FLOAT NOT NULL, quality FLOAT NOT NULL,
    count INTEGER NOT NULL, usage INTEGER NOT NULL, recalled INTEGER NOT NULL, dedup_key VARCHAR NOT NULL,
    links VARCHAR NOT NULL, verifier VARCHAR NOT NULL, signature VARCHAR NOT NULL, skill VARCHAR NOT NULL,
    effect VARCHAR NOT NULL, provenance VARCHAR NOT NULL, note VARCHAR NOT NULL, embedding BLOB NOT NULL,
    embedding_model VARCHAR NOT NULL, created FLOAT NOT NULL, updated FLOAT NOT NULL, version INTEGER NOT NULL,
    rev INTEGER NOT NULL, PRIMARY KEY (id), UNIQUE (bank, dedup_key));
CREATE INDEX ix_memory_bank ON memory (bank);
CREATE INDEX ix_memory_state ON memory (state);
INSERT INTO memory_meta VALUES ('schema', '1');
"""
VECTOR = np.linspace(0, 1, 8, dtype="<f4")


def row(id: str, bank: str = "b", **fields: object) -> dict[str, object]:
    defaults = {
        "id": id, "bank": bank, "query": "Pick up the red cube", "content": f"what {id} says", "type": "tool_usage",
        "state": "active", "outcome": "verified_success", "confidence": 0.9, "quality": 0.95, "count": 3, "usage": 2,
        "recalled": 4, "dedup_key": f"key of {id}", "links": "[]", "verifier": '{"verifier":"test"}',
        "signature": '{"height":0.1}', "skill": "pick", "effect": '{"kind":"prior","value":0.02}',
        "provenance": '{"made_by":{},"sources":["run/1"]}', "note": "", "embedding": VECTOR.tobytes(),
        "embedding_model": "m", "created": NOW - 10, "updated": NOW, "version": 5, "rev": 7,
    }  # fmt: skip
    return {**defaults, **fields}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "memory.db"
    rows = [
        row("1", links='[{"kind":"conflict","target":"2"},{"kind":"conflict","target":"gone"},7]'),
        row("2", rev=6, state="archive", updated=NOW + 5),
        row("no-vector", embedding=b"", embedding_model=""),
        row("short-vector", embedding=b"\x00" * 8),
        row("nan-vector", embedding=np.full(8, np.nan, "<f4").tobytes()),
        row("bad-effect", effect="{"),
        row("bad-links", links="{"),
        row("1c", bank="c"),
    ]
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.executescript("PRAGMA journal_mode=WAL;" + SCHEMA_1)
        names = list(rows[0])
        marks = ", ".join("?" * len(names))
        connection.executemany(
            f"INSERT INTO memory ({', '.join(names)}) VALUES ({marks})", [[r[n] for n in names] for r in rows]
        )
    return path


def test_rows_vectors_links_and_events(old: Path) -> None:
    with Store.open(f"sqlite:///{old}") as store:
        records = {r.id: r for r in store.records("b")}
        assert set(records) == {"1", "2", "no-vector", "short-vector", "nan-vector", "bad-links"}
        first = records["1"]
        assert (first.content, first.count, first.usage, first.recalled) == ("what 1 says", 3, 2, 4)
        assert (first.created, first.updated, first.used, first.version) == (NOW - 10, NOW, 0.0, 1)
        assert first.effect_json() == {"kind": "prior", "value": 0.02}
        assert [(k.source, k.kind, k.target) for k in store.links("b")] == [("1", "conflict", "2")]
        vectors = {c.record.id: c.vector for c in store.changes("b", 0)}
        np.testing.assert_array_equal(vectors["1"], VECTOR)
        assert [id for id, v in vectors.items() if v is None] == ["nan-vector", "no-vector", "short-vector"]
        assert [e.action for e in store.history("b", "1")] == ["imported", "link:conflict"]
        assert [str(p) for p in store.verify("b")] == [
            "record bad-effect: damaged: effect is no sound JSON (Expecting property name enclosed in double quotes: "
            "line 1 column 2 (char 1))."
        ]
        assert [r.id for r in store.records("c")] == ["1c"]
        assert store.verify("c") == []
        assert store.banks() == ["b", "c"]


def test_a_copy_is_made_first_and_named(old: Path) -> None:
    Store.open(f"sqlite:///{old}").close()
    copy = old.with_name("memory.db.before-schema-2")
    with closing(sqlite3.connect(copy)) as connection:
        assert connection.execute("SELECT value FROM memory_meta").fetchall() == [("1",)]
        assert connection.execute("SELECT COUNT(*) FROM memory").fetchone() == (8,)
    before = copy.read_bytes()
    Store.open(f"sqlite:///{old}").close()  # migrated already
    assert copy.read_bytes() == before
    assert sorted(p.name for p in old.parent.iterdir() if "before" in p.name) == [copy.name]


def test_a_migration_that_fails_changes_nothing(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr(migrations, "_import_bank", fails)
    with pytest.raises(MemoryStoreError, match="full"):
        Store.open(f"sqlite:///{old}")
    with closing(sqlite3.connect(old)) as connection:
        assert connection.execute("SELECT value FROM memory_meta").fetchall() == [("1",)]
        assert connection.execute("SELECT COUNT(*) FROM memory").fetchone() == (8,)
        tables = {r[0] for r in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    assert tables == {"memory", "memory_meta"}
    monkeypatch.undo()
    with Store.open(f"sqlite:///{old}") as store:  # and a second attempt succeeds, with a copy of its own
        assert len(store.records("b")) == 6
    assert old.with_name("memory.db.before-schema-2.1").exists()


def test_forgetting_reaches_the_copy(old: Path) -> None:
    with Store.open(f"sqlite:///{old}") as store:
        copy = old.with_name("memory.db.before-schema-2")
        assert b"what 1 says" in copy.read_bytes()
        with store.writing("b", actor="owner", now=NOW) as t:
            assert t.forget("1")
        for path in old.parent.iterdir():
            assert b"what 1 says" not in path.read_bytes()
        assert b"what 2 says" in copy.read_bytes()


def test_forgetting_leaves_the_users_files_alone(old: Path) -> None:
    """Only what a migration itself leaves is its own, half copies among it."""
    begin = "memory.db.before-schema-"
    theirs = ["2.gz", "change-notes.txt", "2.1.bak", "2.old", "", "2-notes", "2.part.txt", "2 (copy)", "x.1"]
    own = ["2.part", "2.7", "1"]
    for name in (*theirs, *own):
        old.with_name(begin + name).write_bytes(b"not a database")
    other = old.with_name("other.db.before-schema-2")
    other.write_bytes(b"of another memory")
    with Store.open(f"sqlite:///{old}") as store:
        with store.writing("b", actor="owner", now=NOW) as t:
            assert t.forget("1")
        store.compact()
    assert all(old.with_name(begin + name).read_bytes() == b"not a database" for name in theirs)
    assert other.exists()
    assert not any(old.with_name(begin + name).exists() for name in own)
    assert old.with_name(begin + "2").exists()


def test_who_is_killed_while_copying_leaves_no_half_copy(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The copy gets its name when it is whole; what is left of one that is not is taken away the next time."""
    names: list[list[str]] = []
    fsync = os.fsync

    def looked(handle: int) -> None:
        names.append(sorted(path.name for path in old.parent.iterdir() if "before" in path.name))
        fsync(handle)

    part = old.with_name("memory.db.before-schema-2.part")
    part.write_bytes(b"half")
    monkeypatch.setattr(os, "fsync", looked)
    Store.open(f"sqlite:///{old}").close()
    assert names[0] == [part.name]
    assert [path.name for path in old.parent.iterdir() if "before" in path.name] == [
        "memory.db.before-schema-2"
    ]
