"""Whatever bytes a damaged file holds: verify says what is wrong, and the rest goes on."""

import random
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from itertools import product
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson
from gvla2.memory.options import BankOptions
from gvla2.memory.tables import TABLES
from gvla2.memory.view import Problem

ODD = (b"\xff\xfe", b"", "", "much", "'", "[]", "{}", '{"id":1}', "NaN", -1, 2**62, 1e308, float("inf"))
"""Values that a damaged cell may hold."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file of a bank with records, links and episodes."""
    path = tmp_path_factory.mktemp("bank") / "m.db"
    with KnowledgeBank(path, options=BankOptions(governance=True)) as bank:
        for i, number in enumerate((15, 12, 20, 30)):
            bank.learn(f"lift cup {i}", f"$ lift --cm {number}", success=True, source=f"run/{i}")
        for text in ("Always open the drawer slowly.", "Never open the drawer slowly.", "Städte sortieren."):
            bank.admit(text, trusted=True)
        assert bank.verify() == []
        bound = {"kind": "bound", "parameter": "pull", "op": ">=", "value": 0.3}
        for bounds in (bound, {**bound, "op": "<=", "value": 0.1}):
            bank.admit(Lesson("tool_usage", f"Pull {bounds['op']}.", bounds), trusted=True)
        assert bank.stats()["links"] == 1
    return path.read_bytes()


def looked_at(bank: KnowledgeBank) -> Iterator[list[Problem]]:
    """The problems, if our own error does not say what is wrong; recall goes on, or says the same."""
    with suppress(MemoryStoreError):
        yield bank.verify()
    with suppress(MemoryStoreError):
        bank.recall("open the drawer")


@pytest.mark.parametrize("seed", range(18))
def test_flipped_bytes(sound: bytes, tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    damaged = bytearray(sound)
    for _ in range(rng.choice((1, 3, 20, 200))):
        damaged[rng.randrange(4096, len(damaged))] ^= rng.randrange(1, 256)  # behind the table of tables
    (tmp_path / "m.db").write_bytes(damaged)
    with suppress(MemoryStoreError), KnowledgeBank(tmp_path / "m.db") as bank:
        for problems in looked_at(bank):
            assert all(str(problem) for problem in problems)


@pytest.mark.parametrize("table", [table for table in TABLES if table.name != "memory_meta"], ids=str)
def test_cells_that_hold_anything(sound: bytes, tmp_path: Path, table) -> None:
    path, kept = tmp_path / "m.db", tmp_path / "sound.db"
    path.write_bytes(sound)
    kept.write_bytes(sound)
    # One bank for all: what opens one compiles its queries, which takes longer than to look through so small a file.
    with closing(sqlite3.connect(kept)) as whole, KnowledgeBank(path) as bank:
        for column, value in product([column.name for column in table.columns], ODD):
            with closing(sqlite3.connect(path)) as raw:
                whole.backup(raw)
                with raw:
                    row, before = raw.execute(f"SELECT rowid, {column} FROM {table.name} LIMIT 1").fetchone()
                    raw.execute(f"UPDATE {table.name} SET {column} = ? WHERE rowid = ?", (value, row))
            found = list(looked_at(bank))
            if found and value != before and table.name == "memory_event":
                assert {problem.where for problem in found[0]} & {"chain", "event"}, (column, value)
