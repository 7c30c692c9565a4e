"""What verify finds beyond the chain itself: an end that was cut off, swapped vectors; and what headers give away."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.records import Record, dump
from gvla2.memory.storage.store import Store, StoredEpisode
from gvla2.memory.storage.transaction import episode_digest

NOW = 1.8e9
GOOD = Verdict.from_criteria({"done": 1.0})
Make = Callable[..., Record]


def changed(path: Path, script: str) -> None:
    with closing(sqlite3.connect(path)) as other:
        other.executescript(script)


def test_an_end_that_was_cut_off_is_found_by_a_head_kept_elsewhere(sqlite_url: str, tmp_path: Path) -> None:
    with KnowledgeBank.open(sqlite_url) as bank:
        for what in ("lift the cup", "fold the towel", "sort the bolts"):
            bank.admit(Lesson("procedural_hint", f"To {what}, begin on the left."), GOOD, task=what)
        stats = bank.stats()
        head = f"{stats['seq']}:{stats['hash']}"
        assert bank.verify(head=head) == []
        bank.admit(Lesson("procedural_hint", "To pour, begin on the right."), GOOD, task="pour")
        assert bank.verify(head=head) == []  # what came later does not matter
        for wrong in ("3", "x:y", "3:", f"-1:{head}"):
            with pytest.raises(MemoryStoreError, match="SEQ:HASH"):
                bank.verify(head=wrong)
        assert [str(p) for p in bank.verify(head=head.replace("3:", "2:"))] == [
            "chain 2: it is another than the head that was kept elsewhere: the chain was written anew."
        ]
    changed(
        tmp_path / "memory.db",
        "DELETE FROM memory WHERE rev > 2; DELETE FROM memory_vector WHERE id NOT IN (SELECT id FROM memory);"
        "DELETE FROM memory_event WHERE seq > 2; UPDATE memory_bank SET (seq, rev, at, hash) = "
        "(SELECT seq, rev, at, hash FROM memory_event WHERE seq = 2);",
    )
    with Store.open(sqlite_url) as store:
        assert store.verify("default") == []
        assert [str(p) for p in store.verify("default", head=head)] == [
            "chain 3: the head that was kept elsewhere is missing: the end of the chain was cut off."
        ]


def test_swapped_vectors_are_found(sqlite_url: str, tmp_path: Path) -> None:
    with KnowledgeBank.open(sqlite_url) as bank:
        for what in ("lift the cup", "fold the towel", "sort the bolts"):
            bank.admit(Lesson("procedural_hint", f"To {what}, begin on the left."), GOOD, task=what)
        first, second, third = (record.id for record in bank.records())
        assert bank.verify() == []
        changed(
            tmp_path / "memory.db",
            f"UPDATE memory_vector SET id = CASE id WHEN '{first}' THEN 'x' ELSE id END;"
            f"UPDATE memory_vector SET id = '{first}' WHERE id = '{second}';"
            f"UPDATE memory_vector SET id = '{second}' WHERE id = 'x';"
            f"UPDATE memory_vector SET vector = zeroblob(length(vector)) WHERE id = '{third}';",
        )
        assert {str(p) for p in bank.verify()} == {
            f"vector {first}: it is that of {second}, not of what the record says.",
            f"vector {second}: it is that of {first}, not of what the record says.",
            f"vector {third}: it was not made of what the record says.",
        }


def test_vectors_that_grew_are_nobodys_elses(sqlite_url: str) -> None:
    with KnowledgeBank.open(sqlite_url) as bank:
        for i, words in enumerate(("lift the cup", "raise the cup up", "lift up the cup", "lift the mug")):
            lesson = Lesson("procedural_hint", "Lift the cup slowly by its handle." + "!" * (i % 2))
            bank.learn(MemoryEpisode(MemoryTask(words), (lesson,), source=f"run/{i}"), GOOD)
        assert any(record.count > 1 for record in bank.records())
        bank.govern()
        assert bank.verify() == []


# What an event's header says of an episode ----------------------------------------------------------------------------


def test_a_source_is_in_no_header_and_goes(sqlite_url: str, tmp_path: Path) -> None:
    source = "run/email DR\\SMITH 100% 'about' results_1"
    with KnowledgeBank.open(sqlite_url) as bank:
        for text in ("one", "two"):
            lesson = Lesson("procedural_hint", "Use the mail tool.")
            bank.learn(MemoryEpisode(MemoryTask("mail"), (lesson,), text, source=source), GOOD)
        other = MemoryEpisode(
            MemoryTask("q"), (Lesson("procedural_hint", "Fold it."),), source=source.lower()
        )
        bank.learn(other, GOOD)
        store = bank._store
        assert [e.action for e in bank.history(source)] == ["episode", "episode"]
        names = {e.record for e in bank.history(source)}
        assert all(name.startswith("episode-") for name in names)
        assert not [e for e in store.events("default") if "SMITH" in e.record + e.target]
        (taught,) = [r.id for r in bank.records() if "mail" in r.content]
        assert bank.forget(taught)
        assert [p.name for p in tmp_path.iterdir() if b"SMITH" in p.read_bytes()] == []
        assert bank.history(source) == []
        assert [e.source for e in store.episodes("default")] == [source.lower()]
        assert {e.record for e in store.events("default") if e.action == "forget"} == {taught, *names}
        assert bank.verify() == []


def test_older_banks_hold_and_forget(store: Store, record: Make) -> None:
    """There, the header named the source: the chain still verifies, and what it can still forget, it forgets."""
    episode = StoredEpisode("run/old", NOW, MemoryTask("q"), records=("hint-1",))
    with store.writing("b", actor="a", now=NOW) as t:
        t.put(record("hint-1"), action="add")
        t.save_episode(episode)
        t.flush()
        t._sql.run("DELETE FROM memory_event WHERE action = 'episode'", ())
        t._seq -= 1
        t._written -= 1
        t._hash = t._sql.rows("SELECT hash FROM memory_event ORDER BY seq DESC")[0][0]
        t.record_event("episode", "run/old", change=dump({"episode": episode_digest(NOW, episode.to_json())}))
    assert store.verify("b") == []
    with store.writing("b", actor="a", now=NOW) as t:
        t.save_episode(StoredEpisode("run/old", NOW + 1, MemoryTask("q"), records=("hint-1",)))
    assert store.verify("b") == []
    assert len(store.history("b", "run/old")) == 2
    with store.writing("b", actor="a", now=NOW) as t:
        assert t.forget("hint-1")
    assert store.episodes("b") == []
    assert all(event.erased for event in store.events("b") if event.action == "episode")
    assert store.verify("b") == []
