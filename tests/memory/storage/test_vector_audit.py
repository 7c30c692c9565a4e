"""A vector that was made of any of a record's phrasings is its own; one that was made of none is found."""

from collections.abc import Iterator

import pytest

from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, Verdict

MAYBE = Verdict.from_criteria({"done": 0.5}, verifier="v")
GOOD = Verdict.from_criteria({"done": 1.0}, verifier="v")
PARTS = (
    "bolt",
    "washer",
    "flange",
    "gasket",
    "bearing",
    "rotor",
    "stator",
    "housing",
    "bracket",
    "spring",
    "clip",
)
LONG = " ".join(
    f"Check item {part} against the delivery note of pallet {i} and sign it." for i, part in enumerate(PARTS)
)
KNOCK = Lesson("procedural_hint", "Knock twice.")


@pytest.fixture
def bank(sqlite_url: str) -> Iterator[KnowledgeBank]:
    with KnowledgeBank.open(sqlite_url) as opened:
        yield opened


def restarted(bank: KnowledgeBank) -> str:
    """A record of one episode that has the tasks of two: an uncertain one of many words, then a verified one."""
    assert bank.admit(KNOCK, MAYBE, task=LONG, source="a").provisional
    bank.admit(KNOCK, GOOD, task="Enter", source="b")
    (record,) = bank.records()
    assert (record.state, record.count, len(record.query.split("\n"))) == ("active", 1, 2)
    return record.id


def test_the_vector_of_one_phrasing_is_the_records_own(bank: KnowledgeBank) -> None:
    restarted(bank)
    assert bank.verify() == []


def test_nor_is_it_taken_for_that_of_a_like_record(bank: KnowledgeBank) -> None:
    restarted(bank)
    bank.admit(Lesson("tool_usage", "Knock twice ."), GOOD, task="Enter", source="c")
    assert len(bank.records()) == 2
    assert bank.verify() == []


def test_a_vector_of_none_of_its_phrasings_is_found(bank: KnowledgeBank) -> None:
    id = restarted(bank)
    bank.admit(Lesson("tool_usage", "Rinse the brush in cold water."), GOOD, task="clean up", source="c")
    with bank._store._database.writing("default") as raw:
        (other,) = raw.rows("SELECT vector FROM memory_vector WHERE id <> ?", (id,))
        assert raw.run("UPDATE memory_vector SET vector = ? WHERE id = ?", (other[0], id))
    assert {(problem.where, problem.id) for problem in bank.verify()} == {("vector", id)}


def test_a_phrasing_that_found_no_room_is_no_reason_for_alarm(bank: KnowledgeBank) -> None:
    for i, part in enumerate(PARTS[:8]):
        bank.admit(KNOCK, MAYBE, task=f"{part} {LONG[i * 60 : i * 60 + 300]}", source=f"run/{i}")
    bank.admit(KNOCK, GOOD, task="Enter the room of the director on the upper floor", source="z")
    (record,) = bank.records()
    assert (record.count, len(record.query.split("\n")), "director" in record.query) == (1, 8, False)
    assert bank.verify() == []
