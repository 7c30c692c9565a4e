"""The index follows its store, exactly."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gvla2.memory.embedding import StaticEmbedder, record_vectors
from gvla2.memory.index import Index
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from tests.memory.corpus import lessons
from tests.memory.looking import ids_of, look

EMBEDDER = StaticEmbedder()
NOW = 1.8e9
QUERY = "pick up the red cube near the mug"


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.open(f"sqlite:///{tmp_path / 'memory.db'}") as opened:
        yield opened


def put(store: Store, records: list[Record], *, vectors: bool = True, model: str = EMBEDDER.model) -> None:
    made = record_vectors(EMBEDDER, [(r.query, r.content) for r in records])
    with store.writing("default", actor="test", now=NOW) as transaction:
        for record, vector in zip(records, made, strict=True):
            transaction.put(record, "add", vector=vector if vectors else None, model=model if vectors else "")


def stored(store: Store, id: str) -> Record:
    (record,) = look(store, "default").records(ids=[id])
    return record


def fresh(store: Store) -> Index:
    index = Index(store, "default", EMBEDDER)
    index.refresh()
    return index


def active(index: Index) -> list[str]:
    return ids_of(index.candidates(["active"]))


def same(index: Index, store: Store) -> None:
    """The index answers as one does that reads all of the store anew."""
    other = fresh(store)
    one, two = (each.candidates(["active"], now=NOW) for each in (index, other))
    assert ids_of(one) == ids_of(two)
    np.testing.assert_array_equal(one.lexical(QUERY), two.lexical(QUERY))
    np.testing.assert_array_equal(one.vectors, two.vectors)
    for mine, theirs in zip(one, two, strict=True):
        assert (mine.record, mine.conflicts) == (theirs.record, theirs.conflicts)


def test_it_follows_any_change(store: Store) -> None:
    put(store, lessons(40, now=NOW))
    index = fresh(store)
    ids = active(index)
    program = '{"kind":"program","skill":"pick","roles":{"theme":"cup"},"steps":[]}'
    changes = [
        replace(stored(store, ids[0]), usage=7, confidence=0.1, updated=NOW + 5),
        replace(stored(store, ids[1]), content="entirely other words: ein roter Würfel"),
        replace(stored(store, ids[2]), state="archive"),
        replace(stored(store, ids[3]), state="provisional"),
        replace(stored(store, ids[4]), effect=program),
    ]
    put(store, changes)
    put(store, lessons(20, 99, now=NOW))
    with store.writing("default", actor="test", now=NOW) as transaction:
        transaction.link(ids[5], "conflict", ids[6])
        transaction.link(ids[5], "dismissed", ids[7])
        transaction.forget(ids[8])
    index.refresh()
    same(index, store)
    candidates = index.candidates(["active"])
    assert not {ids[2], ids[3], ids[8]} & set(active(index))
    assert ids_of(index.candidates(["provisional"])) == [ids[3]]
    places = {id: row for row, id in enumerate(active(index))}
    assert [candidates[places[ids[i]]].conflicts for i in (5, 6, 7)] == [1, 1, 0]
    assert candidates.record(places[ids[4]]).effect == program
    assert index.get("no such id") is index.get(ids[2]) is None
    put(store, [replace(stored(store, ids[2]), state="active")])
    index.refresh()
    assert ids[2] in active(index)
    same(index, store)


def test_vectors_of_another_model_or_missing_are_made_anew(store: Store) -> None:
    records = lessons(6, now=NOW)
    put(store, records[:2], model="another-model")
    put(store, records[2:4], vectors=False)
    put(store, records[4:])
    index = fresh(store)
    expected = record_vectors(EMBEDDER, [(r.query, r.content) for r in records])
    for record, vector in zip(records, expected, strict=True):
        np.testing.assert_array_equal(index.get(record.id).vector, vector)


def test_another_database_in_its_place_is_read_anew(store: Store, tmp_path: Path) -> None:
    for seed in (1, 2, 3):
        put(store, lessons(5, seed, now=NOW))
    index = fresh(store)
    with Store.open(f"sqlite:///{tmp_path / 'other.db'}") as other:
        put(other, lessons(4, 9, now=NOW))
        index._store = other  # what a restored backup looks like from here: the same bank, an earlier rev
        index.refresh()
        same(index, other)
