"""Vectors that were made of another text than the record's are named; what grew honestly is not."""

import sqlite3
from contextlib import closing
from pathlib import Path

from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict

GOOD = Verdict.from_criteria({"done": 1.0})


def test_swapped_vectors_are_found(tmp_path: Path) -> None:
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        for what in ("lift the cup", "fold the towel", "sort the bolts"):
            bank.admit(
                Lesson("procedural_hint", f"To {what}, begin on the left."), GOOD, task=what, trusted=True
            )
        first, second, third = (record.id for record in bank.records())
        assert bank.verify() == []
        with closing(sqlite3.connect(tmp_path / "memory.db")) as other:
            other.executescript(
                f"UPDATE memory_vector SET id = CASE id WHEN '{first}' THEN 'x' ELSE id END;"
                f"UPDATE memory_vector SET id = '{first}' WHERE id = '{second}';"
                f"UPDATE memory_vector SET id = '{second}' WHERE id = 'x';"
                f"UPDATE memory_vector SET vector = zeroblob(length(vector)) WHERE id = '{third}';"
            )
        assert {str(p) for p in bank.verify()} == {
            f"vector {id}: it does not match the record's text." for id in (first, second, third)
        }


def test_a_record_that_grew_has_the_vector_of_its_text(tmp_path: Path) -> None:
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        for i, words in enumerate(("lift the cup", "raise the cup up", "lift up the cup", "lift the mug")):
            lesson = Lesson("procedural_hint", "Lift the cup slowly by its handle." + "!" * (i % 2))
            bank.learn(MemoryEpisode(MemoryTask(words), (lesson,), source=f"run/{i}"), GOOD)
        assert any(record.count > 1 for record in bank.records())
        bank.govern()
        assert bank.stats()["vectors"] >= len(bank.records(["active", "summary"]))
        assert bank.verify() == []
