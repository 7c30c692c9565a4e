"""Rows that somebody has changed by hand become again what the events say, for every process that looks."""

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, Verdict
from gvla2.memory.records import COLUMNS, Record
from gvla2.memory.storage.audit import repair
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.writing import Put
from tests.memory.looking import look

GOOD = Verdict.from_criteria({"done": 1.0})
SAID = (
    "Lift the cup 15 cm before you move it.",
    "Turn the lid to the left.",
    "Lift the cup 5 cm before you move it.",
)


@pytest.fixture
def tampered(tmp_path: Path) -> Callable[..., KnowledgeBank]:
    """A bank that is open in one process while another changes its file."""

    def make(*statements: str) -> KnowledgeBank:
        bank = KnowledgeBank(f"sqlite:///{tmp_path / 'm.db'}")
        for text in SAID:
            bank.admit(Lesson("procedural_hint", text), GOOD, task="lift the cup", trusted=True)
        assert bank.recall("lift the cup").items
        with sqlite3.connect(tmp_path / "m.db") as raw:
            for statement in statements:
                assert raw.execute(statement).rowcount
        raw.close()
        return bank

    return make


def repaired(bank: KnowledgeBank):
    with bank.store.writing("default", actor="test", now=2e9) as tx:
        return repair(tx)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE memory SET content = 'Throw the cup.', confidence = 1.0 WHERE content LIKE 'Lift%15%'",
        "UPDATE memory SET state = 'archive'",
        "UPDATE memory SET confidence = 'much'",  # cannot be read
        "UPDATE memory SET dedup_key = 'x' || dedup_key, version = 7",
        "DELETE FROM memory WHERE content LIKE 'Turn%'",
        "DELETE FROM memory_link",
        "UPDATE memory_link SET at = 1.0",
        "UPDATE memory_vector SET vector = x'00'",
        "UPDATE memory SET id = 'hint-0' WHERE content LIKE 'Turn%'",
    ],
)
def test_what_was_changed_is_as_it_was(tampered, statement: str, tmp_path: Path):
    with tampered(statement) as bank:
        assert bank.verify() != []
        before = look(bank.store, "default").rebuilt().records
        done = repaired(bank)
        assert bank.verify() == []
        assert done[0]
        assert {r.content for r in bank.records()} == set(SAID)
        for old, new in zip(before, bank.records(), strict=True):
            assert {n for n in COLUMNS if getattr(old, n) != getattr(new, n)} <= {"version", "rev"}
        assert {hit.record.content for hit in bank.search("lift the cup or turn the lid")} <= set(SAID)
        assert look(bank.store, bank.bank).history(done[0][0])[-1].action == "repair"
        assert bank.verify() == []
    with KnowledgeBank(f"sqlite:///{tmp_path / 'm.db'}") as again:
        assert {item.content for item in again.recall("lift the cup").items} <= set(SAID)
        assert again.admit(
            Lesson("procedural_hint", "Wipe the plate."), GOOD, task="wipe", trusted=True
        ).added


def test_a_row_that_nobody_created_is_forgotten(tampered):
    columns = ", ".join(name for name in COLUMNS if name not in ("id", "dedup_key", "content"))
    with tampered(
        f"INSERT INTO memory (id, dedup_key, content, {columns}) SELECT 'hint-evil', 'k', 'Throw the cup.', {columns} "
        "FROM memory WHERE content LIKE 'Turn%'"
    ) as bank:
        assert any(hit.record.id == "hint-evil" for hit in bank.search("throw the cup")) or bank.verify()
        assert repaired(bank)[1] == ["hint-evil"]
        assert bank.verify() == []
        assert {r.content for r in bank.records()} == set(SAID)


def test_a_sound_bank_is_left_alone(tampered):
    with tampered() as bank:
        rev = bank.stats()["rev"]
        done = repaired(bank)
        assert (done, bank.stats()["rev"]) == (([], []), rev)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("hash = 'x'", "says a different hash"),
        ("rev = 99", "transaction number"),
        ("seq = 99", "says event 99"),
    ],
)
def test_a_changed_head_says_what_differs(tampered, change: str, told: str):
    with tampered(f"UPDATE memory_bank SET {change}") as bank:
        (problem,) = bank.verify()
        assert told in problem.what


@pytest.mark.parametrize(
    "statement", ["UPDATE memory_event SET actor = 'me'", "UPDATE memory_event SET change = '{}'"]
)
def test_changed_events_are_no_ground_to_build_on(tampered, statement: str):
    with tampered(
        statement, "UPDATE memory SET content = 'Throw the cup.' WHERE content LIKE 'Turn%'"
    ) as bank:
        with pytest.raises(MemoryStoreError, match="Restore the database from a copy"):
            repaired(bank)
        assert any(r.content == "Throw the cup." for r in bank.records())


@pytest.mark.parametrize(
    "statements",
    [
        (
            "UPDATE memory SET dedup_key = 'aside' WHERE id = '1'",
            "UPDATE memory SET dedup_key = 'key of 1' WHERE id = '2'",
            "UPDATE memory SET dedup_key = 'key of 2' WHERE id = '1'",
        ),
        (
            "UPDATE memory SET dedup_key = 'key of 3' || id WHERE id = '3'",
            "UPDATE memory SET dedup_key = 'key of 3' WHERE id = '1'",
        ),
        (
            "UPDATE memory SET dedup_key = 'key of 1' || id WHERE id = '1'",
            "UPDATE memory SET dedup_key = 'key of 1' WHERE id = '3'",
        ),
        (
            "DELETE FROM memory WHERE id = '1'",
            "UPDATE memory SET dedup_key = 'key of 1' WHERE id = '2'",
        ),
        (  # what nobody created has a key, and the tombstone's of what nobody created
            "UPDATE memory SET id = 'x' WHERE id = '1'",
            "UPDATE memory SET dedup_key = 'forgotten:x' WHERE id = '2'",
        ),
        (  # a tombstone, too
            "UPDATE memory SET dedup_key = 'aside' WHERE id = '1'",
            "UPDATE memory SET dedup_key = 'key of 1' WHERE id = '4'",
            "UPDATE memory SET dedup_key = 'forgotten:4' WHERE id = '1'",
        ),
    ],
)
def test_dedup_keys_that_were_moved(store: Store, record: Callable[..., Record], statements: tuple[str, ...]):
    with store.writing("b", actor="test", now=1.8e9) as tx:
        tx.put_many([Put(record(id), "add") for id in "1234"])
        tx.forget("4")
    before = look(store, "b").rebuilt()
    with store._database.writing("b") as raw:
        for statement in statements:
            assert raw.exec_driver_sql(statement).rowcount
    assert look(store, "b").verify()
    with store.writing("b", actor="test", now=1.9e9) as tx:
        assert repair(tx)[0]
    assert look(store, "b").verify() == []
    assert {r.id: r.dedup_key for r in look(store, "b").records()} == {id: f"key of {id}" for id in "123"}
    assert [(r.id, r.content) for r in look(store, "b").records()] == [
        (r.id, r.content) for r in before.records
    ]


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE memory SET content = 'Throw the cup.' WHERE id = '1'",
        "DELETE FROM memory WHERE id = '1'",
        "DELETE FROM memory_link",
        "UPDATE memory SET id = 'x' WHERE id = '1'",
    ],
)
def test_rows_of_either_database(store: Store, record: Callable[..., Record], statement: str):
    with store.writing("b", actor="test", now=1.8e9) as tx:
        tx.put_many([Put(record("1"), "add"), Put(record("2"), "add")])
        tx.link_many({("1", "conflict", "2"): ""})
    before = [(r.id, r.content) for r in look(store, "b").records()]
    with store._database.writing("b") as raw:
        assert raw.exec_driver_sql(statement).rowcount
    assert look(store, "b").verify()
    with store.writing("b", actor="test", now=1.9e9) as tx:
        assert repair(tx)[0]
    assert look(store, "b").verify() == []
    assert [(r.id, r.content) for r in look(store, "b").records()] == before
    assert len(look(store, "b").links()) == 1
