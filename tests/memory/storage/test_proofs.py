"""What verify finds beyond the chain itself: an end that was cut off, swapped vectors; and what headers give away."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.storage.store import Store
from tests.memory.looking import look

GOOD = Verdict.from_criteria({"done": 1.0})


def changed(path: Path, script: str) -> None:
    with closing(sqlite3.connect(path)) as other:
        other.executescript(script)


def test_an_end_that_was_cut_off_is_found_by_a_head_kept_elsewhere(sqlite_url: str, tmp_path: Path) -> None:
    with KnowledgeBank(sqlite_url) as bank:
        for what in ("lift the cup", "fold the towel", "sort the bolts"):
            bank.admit(
                Lesson("procedural_hint", f"To {what}, begin on the left."), GOOD, task=what, trusted=True
            )
        stats = bank.stats()
        head = f"{stats['seq']}:{stats['hash']}"
        assert bank.verify(head=head) == []
        bank.admit(Lesson("procedural_hint", "To pour, begin on the right."), GOOD, task="pour", trusted=True)
        assert bank.verify(head=head) == []  # what came later does not matter
        for wrong in ("3", "x:y", "3:", f"-1:{head}"):
            with pytest.raises(MemoryStoreError, match="SEQ:HASH"):
                bank.verify(head=wrong)
        assert [str(p) for p in bank.verify(head=head.replace("3:", "2:"))] == [
            "chain 2: it differs from the head kept elsewhere: the chain was rewritten."
        ]
    changed(
        tmp_path / "memory.db",
        "DELETE FROM memory WHERE rev > 2; DELETE FROM memory_vector WHERE id NOT IN (SELECT id FROM memory);"
        "DELETE FROM memory_event WHERE seq > 2; UPDATE memory_bank SET (seq, rev, at, hash) = "
        "(SELECT seq, rev, at, hash FROM memory_event WHERE seq = 2);",
    )
    with Store.open(sqlite_url) as store:
        assert look(store, "default").verify() == []
        assert [str(p) for p in look(store, "default").verify(head=head)] == [
            "chain 3: the head kept elsewhere is missing: the chain was truncated."
        ]


# What an event's header says of an episode ----------------------------------------------------------------------------


def test_a_source_is_in_no_header_and_goes(sqlite_url: str, tmp_path: Path) -> None:
    source = "run/email DR\\SMITH 100% 'about' results_1"
    with KnowledgeBank(sqlite_url) as bank:
        for text in ("one", "two"):
            lesson = Lesson("procedural_hint", "Use the mail tool.")
            bank.learn(MemoryEpisode(MemoryTask("mail"), (lesson,), text, source=source), GOOD)
        other = MemoryEpisode(
            MemoryTask("q"), (Lesson("procedural_hint", "Fold it."),), source=source.lower()
        )
        bank.learn(other, GOOD)
        store = bank.store
        assert [e.action for e in look(bank.store, bank.bank).history(source)] == ["episode", "episode"]
        names = {e.record for e in look(bank.store, bank.bank).history(source)}
        assert all(name.startswith("episode-") for name in names)
        assert not [e for e in look(store, "default").events() if "SMITH" in e.record + e.target]
        (taught,) = [r.id for r in bank.records() if "mail" in r.content]
        assert bank.forget(taught)
        assert [p.name for p in tmp_path.iterdir() if b"SMITH" in p.read_bytes()] == []
        assert look(bank.store, bank.bank).history(source) == []
        assert [e.source for e in look(store, "default").episodes()] == [source.lower()]
        assert {e.record for e in look(store, "default").events() if e.action == "forget"} == {taught, *names}
        assert bank.verify() == []
