"""What is forgotten is gone to the last byte, the chain still holds, and an index hears of it."""

import os
import random
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import FORGOTTEN, Record
from gvla2.memory.store import Store
from gvla2.memory.tables import StoredEpisode
from gvla2.memory.transaction import Transaction
from tests.memory.looking import look

NOW = 1.8e9
SECRET = "Anna keeps the spare key under the third flowerpot"
Make = Callable[..., Record]


def fill(store: Store, make: Make, vector: np.ndarray) -> None:
    with store.writing("b", actor="learn", now=NOW) as t:
        for i in range(40):
            t.put(make(f"r{i}"), "add", vector=vector, model="m")
        secret = t.put(
            make("s", content=SECRET, provenance='{"sources":["run/s"]}'),
            "add",
            vector=vector * 3,
            model="m",
            why=f"says {SECRET}",
        )
        t.put(replace(secret, note=f"note: {SECRET}", count=2), action="merge")
        t.link("s", "conflict", "r1", f"against {SECRET}")
        t.link("r2", "replaces", "s", f"instead of {SECRET}")
        for source, known in (("run/s", ()), ("run/t", ("s",)), ("run/u", ("r1",))):
            said = SECRET if source != "run/u" else "harmless"
            t.save_episode(StoredEpisode(source, NOW, MemoryTask("q"), transcript=said, records=known))


def holders(folder: Path, text: str = SECRET) -> list[str]:
    return [p.name for p in sorted(folder.rglob("*")) if p.is_file() and text.encode() in p.read_bytes()]


def test_no_byte_is_left_in_the_files(
    sqlite_url: str, tmp_path: Path, record: Make, vector: np.ndarray
) -> None:
    with Store.open(sqlite_url) as store:
        fill(store, record, vector)
        assert holders(tmp_path)
        rev = store.rev("b")
        with store.writing("b", actor="owner", now=NOW + 1) as t:
            assert t.forget("s", why="asked for")
            assert not t.forget("s")
            assert not t.forget("nobody")
        assert holders(tmp_path) == []
        assert (vector * 3).tobytes() not in (tmp_path / "memory.db").read_bytes()
        check_forgotten(store, rev)
    assert holders(tmp_path) == []


def test_forgetting_on_either_database(store: Store, record: Make, vector: np.ndarray) -> None:
    fill(store, record, vector)
    rev = store.rev("b")
    with store.writing("b", actor="owner", now=NOW + 1) as t:
        assert t.forget("s", why="asked for")
    check_forgotten(store, rev)


def check_forgotten(store: Store, rev: int) -> None:
    assert look(store, "b").verify() == []
    assert len(look(store, "b").records()) == 40
    assert look(store, "b").links() == []
    assert list(look(store, "b").episodes()) == ["run/u"]
    assert store.rev("b") == rev + 1
    with store.reading("b") as view:
        (tomb,) = view.rows([FORGOTTEN])
    assert (tomb.id, tomb.content) == ("s", "")
    assert "s" not in {one.record.id for one in look(store, "b").embedded(["active"])}
    *before, last = look(store, "b").history("s")
    assert not any(e.salt or e.change or e.why for e in before)
    assert (last.action, last.why, last.actor) == ("forget", "asked for", "owner")


def test_the_same_may_be_learned_again(store: Store, record: Make, put: Callable[..., Record]) -> None:
    first = put(record("1"))
    with store.writing("b", actor="owner", now=NOW) as t:
        t.forget("1")
        assert t.get("1") is None
        assert t.by_key(first.dedup_key) is None
    again = put(record("1"))
    assert again.version == 3
    assert look(store, "b").records() == [again]
    assert look(store, "b").verify() == []
    with store.writing("b", actor="owner", now=NOW) as t:
        assert t.forget("1")
    assert look(store, "b").verify() == []
    assert look(store, "b").counts()["states"] == {"forgotten": 1}


def test_a_damaged_record_can_be_forgotten(sqlite_url: str, tmp_path: Path, record: Make) -> None:
    with Store.open(sqlite_url) as store:
        with store.writing("b", actor="a", now=NOW) as t:
            t.put(record("1", content=SECRET), action="add")
        with closing(sqlite3.connect(tmp_path / "memory.db")) as other, other:
            other.execute("UPDATE memory SET provenance = '{'")
        with store.writing("b", actor="a", now=NOW) as t:
            assert t.forget("1")
        assert look(store, "b").verify() == []
        assert holders(tmp_path) == []


def test_bytes_that_a_reader_holds_up_are_owned_up_to_and_go_later(
    sqlite_url: str, tmp_path: Path, record: Make, vector: np.ndarray
) -> None:
    with Store.open(sqlite_url, busy_seconds=0.2) as store:
        fill(store, record, vector)
        with closing(sqlite3.connect(tmp_path / "memory.db", isolation_level=None)) as reader:
            reader.execute("BEGIN")
            reader.execute("SELECT COUNT(*) FROM memory").fetchone()
            with (
                pytest.raises(
                    MemoryStoreError, match=r"forgotten, and no longer in the bank.*another process|locked"
                ),
                store.writing("b", actor="owner", now=NOW) as t,
            ):
                t.forget("s")
            assert SECRET not in {r.content for r in look(store, "b").records()}
        store.compact()
        assert look(store, "b").verify() == []
        assert holders(tmp_path) == []


MEMORY_DISK = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
IDS = ("alpha-1", "beta-22", "gamma-3", "delta-4", "omega-5")
TASKS = ("do one", "do two", "do three")
WORDS = ("lift the cup gently by its handle", "turn the big wheel slowly", "press the red lamp twice")
KINDS = ("dismissed", "conflict")
OPERATIONS = ("put", "put", "put", "link", "link", "forget", "decide", "episode")


def link(t: Transaction, source: str, kind: str, target: str) -> None:
    known = {(k.source, k.kind, k.target) for k in t.links([source])}
    if (source, kind, target) not in known and t.get(source) and t.get(target):
        t.link(source, kind, target, f"as {target} says")


def do(t: Transaction, draw: random.Random, make: Callable[..., Record]) -> None:
    operation, (id, other) = draw.choice(OPERATIONS), draw.sample(IDS, 2)
    known, kind, task = t.get(id), draw.choice(KINDS), draw.choice(TASKS)
    if operation == "put":
        sources = f'{{"sources":["run/{draw.randrange(3)}"]}}'
        record = known or make(id, query=task, content=f"{draw.choice(WORDS)} {id[0]}", provenance=sources)
        notes = ("", f"replaced by {other}", f"it contradicts {other}")
        t.put(
            replace(
                record,
                query="\n".join(dict.fromkeys([*record.query.split("\n"), task])),
                note=draw.choice(notes),
                state=draw.choice(["active", "archive"]),
                count=record.count + 1,
            ),
            action=draw.choice(["ADD", "REPLACED", "MERGE"]),
            why=draw.choice(["", f"outweighs {other}"]),
        )
    elif operation == "link":
        link(t, id, kind, other)
    elif operation == "forget":
        t.forget(id)
    elif operation == "decide":
        t.decide("DISCARD", draw.choice(["", id]), why=f"{other} says it already")
    elif operation == "episode":
        t.save_episode(StoredEpisode(f"run/{draw.randrange(3)}", t.now, MemoryTask("q"), records=(id,)))


@pytest.mark.parametrize("seed", range(24))
def test_any_order(seed: int, record: Callable[..., Record]) -> None:
    draw = random.Random(seed)
    with (
        tempfile.TemporaryDirectory(dir=MEMORY_DISK) as folder,
        Store.open(f"sqlite:///{folder}/m.db") as store,
    ):
        for step in range(draw.randint(2, 8)):
            with store.writing("b", actor="random", now=NOW + step) as t:
                for _ in range(draw.randint(1, 6)):
                    do(t, draw, record)
            assert look(store, "b").verify() == []
            living = {r.id for r in look(store, "b").records()}
            gone = set(t.forgotten) - living
            assert not [
                e for e in look(store, "b").events() if e.record in gone and e.change and e.action != "forget"
            ]
