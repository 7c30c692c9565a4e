"""What is put in comes out: versions, transactions, links, vectors, episodes, and what is refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.tables import StoredEpisode
from tests.memory.looking import look

NOW = 1.8e9
Make = Callable[..., Record]


def test_a_record_comes_back_as_it_was_stored(
    store: Store, record: Make, put: Make, vector: np.ndarray
) -> None:
    stored = put(record(effect='{"value":0.1}', confidence=np.float32(0.5), quality=1), vector)
    assert (stored.version, stored.rev, stored.confidence) == (1, 1, 0.5)
    assert look(store, "b").records() == [stored]
    assert type(stored.quality) is float
    (one,) = look(store, "b").embedded(["active"])
    assert (one.record, one.model, one.conflicts) == (stored, "m", 0)
    np.testing.assert_array_equal(one.vector, vector)
    assert store.rev("b") == 1
    assert store.rev("other") == 0
    assert look(store, "b").verify() == []


def test_an_update_counts_and_a_stale_one_is_refused(store: Store, record: Make, put: Make) -> None:
    first = put(record())
    second = put(replace(first, count=2))
    assert (second.version, second.rev, second.count) == (2, 2, 2)
    with pytest.raises(MemoryStoreError, match="version 2 by now, not 1"):
        put(replace(first, count=9))
    with pytest.raises(MemoryStoreError, match="not 0"):
        put(record())
    with pytest.raises(MemoryStoreError, match="of version 0 by now, not 4"):
        put(record("new", version=4))
    assert look(store, "b").records() == [second]
    assert look(store, "b").verify() == []


def test_a_transaction_is_whole_or_nothing_and_has_one_rev(store: Store, record: Make) -> None:
    with store.writing("b", actor="a", now=NOW) as t:
        t.put(record("1"), action="add")
        for i in range(2, 5):
            t.put(record(str(i)), "add")
        t.link("1", "conflict", "2", "they differ")
        again = t.get("1")
        t.put(replace(again, count=5), action="merge")
    assert {r.rev for r in look(store, "b").records()} == {1}
    for interruption in (KeyboardInterrupt, ValueError):
        with pytest.raises(interruption):
            interrupted(store, record("9"), interruption)
    assert [r.id for r in look(store, "b").records()] == ["1", "2", "3", "4"]
    assert len(look(store, "b").links()) == 1
    assert store.rev("b") == 1
    with store.writing("b", actor="a", now=NOW):
        pass  # nothing happens
    assert store.rev("b") == 1
    assert look(store, "b").verify() == []


def interrupted(store: Store, record: Record, interruption: type[BaseException]) -> None:
    with store.writing("b", actor="a", now=NOW) as t:
        t.put(record, action="add")
        raise interruption


def test_a_dedup_key_belongs_to_one_record(store: Store, record: Make, put: Make) -> None:
    put(record("1", dedup_key="k"))
    with pytest.raises(MemoryStoreError, match="dedup_key"):
        put(record("2", dedup_key="k"))


def test_a_link_counts_for_both_ends(store: Store, record: Make, put: Make) -> None:
    for id in "123":
        put(record(id))
    rev = store.rev("b")
    with store.writing("b", actor="a", now=NOW) as t:
        for _ in range(2):  # once is enough
            t.link("1", "conflict", "2")
    assert store.rev("b") == rev + 1
    assert [one.conflicts for one in look(store, "b").embedded(["active"])] == [1, 1, 0]
    (link,) = look(store, "b").links(["2"])
    assert (link.source, link.kind, link.target, link.at) == ("1", "conflict", "2", NOW)
    assert look(store, "b").verify() == []


def test_text_of_any_kind_is_kept_or_cleaned(store: Store, record: Make, put: Make) -> None:
    texts = [
        "",
        "x" * 1_000_000,
        "\x01\x1b[31m\r\n\t\u2028 тест 机器人 🤖",
        "a\x00b",
        "lone \ud800 half",
        "\\u0000",
    ]
    for i, text in enumerate(texts):
        put(record(str(i), content=text, note=text[:50]))
    assert [r.content for r in look(store, "b").records()] == [*texts[:3], "ab", "lone ? half", "\\u0000"]
    assert look(store, "b").verify() == []


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"confidence": float("nan")}, "confidence is not a finite number"),
        ({"updated": float("inf")}, "updated is not a finite number"),
        ({"effect": "{"}, "effect is not valid JSON"),
        ({"effect": "[1]"}, "effect is not valid JSON"),
        ({"verifier": '{"a":NaN}'}, "verifier is not valid JSON"),
        ({"verifier": ""}, "verifier is not valid JSON"),
        ({"content": None}, "content of a wrong type"),
        ({"count": 2**63}, "count is not a count"),
        ({"bank": "other"}, "cannot be stored in bank 'b'"),
        ({"id": ""}, "cannot be stored"),
        ({"dedup_key": ""}, "cannot be stored"),
        ({"state": "forgotten"}, "cannot be stored"),
    ],
)
def test_unsound_records_are_refused(
    store: Store, record: Make, fields: dict[str, object], said: str
) -> None:
    with store.writing("b", actor="a", now=NOW) as t, pytest.raises(MemoryStoreError, match=said):
        t.put(record(**fields), action="add")
    assert look(store, "b").records() == []


def test_vectors_are_kept_with_their_model(store: Store, record: Make, put: Make, vector: np.ndarray) -> None:
    put(record("1"), vector)
    with store.writing("b", actor="a", now=NOW) as t:
        t.put(record("2"), "add", vector=np.ones(8), model="another")
    assert [c.model for c in look(store, "b").embedded(["active"])] == ["m", "another"]
    assert look(store, "b").verify() == []


def test_a_vector_goes_with_the_text_it_was_made_of(
    store: Store, record: Make, put: Make, vector: np.ndarray
) -> None:
    first = put(record("1"), vector)
    second = put(replace(first, count=2))
    assert look(store, "b").embedded(["active"])[0].vector is not None
    third = put(replace(second, content="something else"))
    assert look(store, "b").embedded(["active"])[0].vector is None
    with store.writing("b", actor="index", now=0.0) as t:
        t.save_vectors("m", [(second, vector)])  # made of a text that is no more
        t.save_vectors("m2", [(third, np.ones(4)), (record("gone"), np.ones(4))])
    (change,) = look(store, "b").embedded(["active"])
    assert (change.model, change.record) == ("m2", third)
    assert look(store, "b").verify() == []
    assert store.rev("b") == third.rev  # derived data are no change


def test_time_never_runs_backwards(store: Store, record: Make, put: Make) -> None:
    put(record("1"), now=NOW + 100)
    put(record("2"), now=NOW)
    assert [e.at for e in look(store, "b").events()] == [NOW + 100, NOW + 100]
    with store.writing("b", actor="a", now=NOW - 5) as t:
        assert t.now == NOW + 100
    assert look(store, "b").verify() == []


EPISODE = StoredEpisode(
    source="run/1",
    at=NOW,
    task=MemoryTask("Pick up the red cube", "pick"),
    transcript="it moved\nand it lifted",
    facts={"exit_status": 0},
    judged=1,
    records=("hint-1",),
)


def test_episodes_come_back_for_replay(store: Store) -> None:
    other, later = replace(EPISODE, source="run/2", at=NOW - 1), replace(EPISODE, judged=2)
    with store.writing("b", actor="a", now=NOW) as t:
        t.save_episode(EPISODE)
        t.save_episode(other)
    assert look(store, "b").episodes() == {"run/1": EPISODE, "run/2": other}
    with store.writing("b", actor="a", now=NOW) as t:
        t.save_episode(later)
    assert look(store, "b").episodes(["run/1"]) == {"run/1": later}
    assert look(store, "b").verify() == []


def test_reading_is_one_instant(store: Store, url: str, record: Make, put: Make) -> None:
    put(record("1"))
    with store.reading("b") as view, Store.open(url) as other:
        before = view.records()
        with other.writing("b", actor="a", now=NOW) as t:
            t.put(record("2"), action="add")
        assert other.rev("b") == 2
        assert (view.rev, view.records()) == (1, before)
    assert store.rev("b") == 2


def test_a_closed_store_says_so(store: Store) -> None:
    store.close()
    store.close()
    with pytest.raises(MemoryStoreError, match="is closed"):
        store.rev("b")
