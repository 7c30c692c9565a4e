"""Whatever is done to a bank, its rows are what its events say, now and at any time before."""

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import Record, as_json, dump
from gvla2.memory.storage.events import StoredEpisode
from gvla2.memory.storage.forgetting import Transaction
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.writing import Put
from tests.memory.looking import look
from tests.memory.storage.rows_as_json import stored_and_rebuilt

NOW = 1.8e9
# What is tested here does not depend on the disk, and forgetting waits for it often.
MEMORY_DISK = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
IDS = st.sampled_from("abcd")
TEXT = st.text(max_size=20)
NUMBER = st.floats(allow_nan=False, allow_infinity=False)
OPERATIONS = st.one_of(
    st.tuples(st.just("put"), IDS, TEXT, NUMBER),
    st.tuples(st.just("put"), IDS, TEXT, NUMBER),
    st.tuples(st.just("archive"), IDS),
    st.tuples(st.just("link"), IDS, st.sampled_from(["conflict", "merged"]), IDS),
    st.tuples(st.just("episode"), IDS, TEXT),
    st.tuples(st.just("decide"), IDS, TEXT),
    st.tuples(st.just("forget"), IDS),
)
# Transactions: how far the clock moves (backwards, too), and what is done.
HISTORIES = st.lists(st.tuples(st.integers(-3, 5), st.lists(OPERATIONS, max_size=5)), max_size=8)


def do(t: Transaction, make: Callable[..., Record], operation: tuple) -> None:
    name, id, *rest = operation
    known = t.get(id)
    if name == "put":
        content, number = rest
        record = known or make(id)
        t.put_many([Put(replace(record, content=content, created=number, count=record.count + 1), "put")])
    elif name == "archive" and known:
        t.put(replace(known, state="archive"), action="archive")
    elif name == "link" and known and rest[1] != id and t.get(rest[1]):
        t.link_many({(id, rest[0], rest[1]): ""})
    elif name == "episode":
        t.save_episodes([StoredEpisode(f"run/{id}", t.now, MemoryTask(rest[0]), records=(id,))])
    elif name == "decide":
        t.decide("discard", id, why=rest[0])
    elif name == "forget":
        t.forget(id)


def lines(records: list[Record]) -> dict[str, str]:
    return {record.id: dump(as_json(record)) for record in records}


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(history=HISTORIES)
def test_rows_are_what_events_say_at_any_time(record: Callable[..., Record], history: list) -> None:
    with (
        tempfile.TemporaryDirectory(dir=MEMORY_DISK) as folder,
        Store.open(f"sqlite:///{folder}/m.db") as store,
    ):
        past: dict[float, dict[str, str]] = {}
        now = NOW
        for step, operations in history:
            now += step
            with store.writing("b", actor="random", now=now) as t:
                for operation in operations:
                    do(t, record, operation)
                at, gone, rev = t.now, list(t.forgotten), t.rev
            for lines_ in past.values():
                for id in gone:
                    lines_.pop(id, None)  # forgotten in the past as well
            if store.rev("b") == rev:  # an empty transaction leaves no trace, of its time neither
                past[at] = lines(look(store, "b").records())
            assert look(store, "b").verify() == []
        stored, rebuilt = stored_and_rebuilt(store)
        assert stored == rebuilt
        for at, expected in past.items():
            assert lines(look(store, "b").as_of(at)) == expected
        seen: dict[str, Record] = {}
        for change in look(store, "b").changes(0):
            seen[change.record.id] = change.record
        assert {id for id, r in seen.items() if r.state != "forgotten"} == set(
            lines(look(store, "b").records())
        )
