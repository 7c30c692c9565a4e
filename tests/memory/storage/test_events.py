"""Every decision is an event: history, and tampering that is found out."""

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.tables import StoredEpisode
from tests.memory.looking import look

NOW = 1.8e9
Make = Callable[..., Record]


def fill(store: Store, make: Make) -> None:
    """Five events: two records, a change, a link, an episode; and a decision."""
    with store.writing("b", actor="learn", now=NOW) as t:
        first = t.put(
            make("1", content="lift 15 cm"),
            action="add",
            why="new",
        )
        t.put(make("2"), action="add")
    with store.writing("b", actor="learn", now=NOW + 1) as t:
        t.put(replace(first, count=2, content="lift 20 cm"), action="merge", why="same surface")
        t.link("1", "conflict", "2", "15 against 5")
    with store.writing("b", actor="learn", now=NOW + 2) as t:
        t.save_episode(StoredEpisode("run/1", NOW + 2, MemoryTask("q"), transcript="it moved"))
        t.decide("discard", "2", why="known already")


def test_history_says_who_what_why_before_and_after(store: Store, record: Make) -> None:
    fill(store, record)
    created, merged, linked = look(store, "b").history("1")
    assert (created.actor, created.action, created.why, created.at) == ("learn", "add", "new", NOW)
    assert created.scores == '{"confidence":0.9,"quality":0.95}'
    assert json.loads(created.change)["content"] == "lift 15 cm"
    assert json.loads(merged.change) == {"count": [1, 2], "content": ["lift 15 cm", "lift 20 cm"]}
    assert (linked.action, linked.target, linked.rev) == ("link:conflict", "2", 2)
    events = look(store, "b").events()
    assert [e.seq for e in events] == [1, 2, 3, 4, 5, 6]
    assert (events[5].action, events[5].change) == ("discard", "")


TAMPERING = {
    "an event's reason is edited": (
        "UPDATE memory_event SET why = 'other' WHERE seq = 3",
        ["event 3: its content was changed"],
    ),
    "an event's actor is edited": (
        "UPDATE memory_event SET actor = 'somebody' WHERE seq = 2",
        ["event 2: its header was changed"],
    ),
    "an event is deleted": (
        "DELETE FROM memory_event WHERE seq = 3",
        ["chain 4: events 3 to 3 are missing", "record 1: it differs"],
    ),
    "the last event is deleted": (
        "DELETE FROM memory_event WHERE seq = 6",
        ["chain: it ends with event 5, the bank's own row says event 6"],
    ),
    "events are swapped": (
        "UPDATE memory_event SET seq = CASE seq WHEN 2 THEN 30 WHEN 3 THEN 2 ELSE seq END;"
        "UPDATE memory_event SET seq = 3 WHERE seq = 30",
        ["chain 2: it does not follow", "event 2: its header was changed", "event 3: its header was changed"],
    ),
    "an event is erased": (
        "UPDATE memory_event SET why = '', scores = '', change = '', state = '', salt = X'' WHERE seq = 3",
        ["event 3: it was erased, and nothing was forgotten afterwards", "record 1: it differs"],
    ),
    "a row is edited": (
        "UPDATE memory SET content = 'lift 99 cm' WHERE id = '1'",
        ["record 1: it differs from what its last event stored"],
    ),
    "a row is deleted": (
        "DELETE FROM memory WHERE id = '2'",
        ["record 2: the events have it, the rows do not"],
    ),
    "a row is slipped in": (
        "INSERT INTO memory SELECT '3', bank, query, content, type, state, outcome, confidence, quality, 'k3', created,"
        " updated, used, count, usage, recalled, verifier, skill, effect, provenance, note, trust,"
        " version, rev"
        " FROM memory WHERE id = '1'",
        ["record 3: no event created it"],
    ),
    "a link is taken away": ("DELETE FROM memory_link", ["link 1 conflict 2"]),
    "an episode is edited": (
        "UPDATE memory_episode SET data = replace(data, 'it moved', 'it flew')",
        ["episode run/1: it is not what was stored"],
    ),
    "an episode is deleted": (
        "DELETE FROM memory_episode",
        ["episode run/1: the events have it, the rows do not"],
    ),
    "the bank's row is deleted": ("DELETE FROM memory_bank", ["chain: the bank's own row is missing"]),
}


@pytest.mark.parametrize("how", TAMPERING)
def test_tampering_is_found_out(sqlite_url: str, tmp_path: Path, record: Make, how: str) -> None:
    statements, expected = TAMPERING[how]
    with Store.open(sqlite_url) as store:
        fill(store, record)
        assert look(store, "b").verify() == []
        with closing(sqlite3.connect(tmp_path / "memory.db")) as other, other:
            for statement in statements.split(";"):
                other.execute(statement)
        found = [str(problem) for problem in look(store, "b").verify()]
        for sentence in expected:
            assert any(problem.startswith(sentence) for problem in found), found


def test_forgetting_the_same_id_again_leaves_others_as_they_were(store: Store, record: Make) -> None:
    """The first forgetting's own event is erased by the second, and unlinks all the same."""
    with store.writing("b", actor="a", now=NOW) as t:
        t.put(record("a"), action="add")
        t.put(record("b"), action="add")
        t.link("a", "conflict", "b")
        t.forget("b")
    with store.writing("b", actor="a", now=NOW) as t:
        t.put(record("b"), action="add")
        t.forget("b")
    assert [r.rev for r in look(store, "b").records()] == [1]
    assert look(store, "b").verify() == []
