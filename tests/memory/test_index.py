"""The index follows its store, exactly."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from corpus import lessons

from gvla2.memory.embedding import StaticEmbedder, record_vectors
from gvla2.memory.index import STATES, Index
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.writing import Put
from tests.memory.looking import ids_of, look

EMBEDDER = StaticEmbedder()
NOW = 1.8e9


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.open(f"sqlite:///{tmp_path / 'memory.db'}") as opened:
        yield opened


def put(store: Store, records: list[Record], *, vectors: bool = True, model: str = EMBEDDER.model) -> None:
    made = record_vectors(EMBEDDER, [(r.query, r.content) for r in records])
    with store.writing("default", actor="test", now=NOW) as transaction:
        transaction.put_many(
            [
                Put(r, "add", v if vectors else None, model if vectors else "")
                for r, v in zip(records, made, strict=True)
            ]
        )


def stored(store: Store, id: str) -> Record:
    (record,) = look(store, "default").records(ids=[id])
    return record


def fresh(store: Store) -> Index:
    index = Index(store, "default", EMBEDDER)
    index.refresh()
    return index


def same(index: Index, store: Store, query: str = "pick up the red cube near the mug") -> None:
    """The index answers as one does that reads all of the store anew."""
    other = fresh(store)
    vector = EMBEDDER.embed([query])[0]
    one, two = index.candidates(now=NOW), other.candidates(now=NOW)
    assert sorted(ids_of(one)) == sorted(ids_of(two))
    place = {id: i for i, id in enumerate(ids_of(two))}
    order = [place[id] for id in ids_of(one)]
    for name in ("confidence", "ages", "usage", "conflicts", "outcomes", "types", "programs"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name)[order])
    np.testing.assert_allclose(one.lexical(query), two.lexical(query)[order], atol=1e-12)
    np.testing.assert_allclose(one.cosine(vector), two.cosine(vector)[order], atol=1e-6)
    for name in ("theme_width", "objects", "unknown"):
        np.testing.assert_array_equal(one.numbers(name), two.numbers(name)[order])
    near, other_near = index.nearest(vector, 5), other.nearest(vector, 5)
    assert [record for record, _ in near] == [record for record, _ in other_near]
    np.testing.assert_allclose([c for _, c in near], [c for _, c in other_near], atol=1e-6)
    assert [one.record(i) for i in range(len(ids_of(one)))] == [two.record(i) for i in order]


def test_it_follows_every_kind_of_change(store: Store) -> None:
    put(store, lessons(60, now=NOW))
    index = fresh(store)
    assert sum(map(index.count, STATES)) == 60
    ids = list(ids_of(index.candidates()))
    first = stored(store, ids[0])
    changes = [
        replace(first, usage=7, confidence=0.1, updated=NOW + 5),
        replace(stored(store, ids[1]), content="entirely other words: ein roter Würfel"),
        replace(stored(store, ids[2]), state="archive"),
        replace(stored(store, ids[3]), state="provisional"),
        replace(stored(store, ids[4]), state="summary", signature='{"theme_width":0.5,"unknown":3.0}'),
    ]
    put(store, changes)
    put(store, lessons(20, 99, now=NOW))
    index.refresh()
    same(index, store)
    served = list(ids_of(index.candidates()))
    assert ids[2] not in served
    assert ids[3] not in served
    assert ids[3] in ids_of(index.candidates(("provisional",)))
    assert index.get("no such id") is index.get(ids[2]) is index.vector(ids[2]) is None
    put(store, [replace(stored(store, ids[2]), state="active")])
    index.refresh()
    assert ids[2] in ids_of(index.candidates())
    same(index, store)


def test_links_count_as_conflicts_on_both_ends(store: Store) -> None:
    put(store, lessons(3, now=NOW))
    index = fresh(store)
    ids = list(ids_of(index.candidates()))
    with store.writing("default", actor="test", now=NOW) as transaction:
        transaction.link(ids[0], "conflict", ids[1])
        transaction.link(ids[2], "dismissed", ids[1])
    index.refresh()
    assert dict(zip(ids_of(index.candidates()), index.candidates().conflicts.tolist(), strict=True)) == {
        ids[0]: 1, ids[1]: 1, ids[2]: 0,
    }  # fmt: skip


def test_forgotten_records_leave_the_index(store: Store) -> None:
    records = lessons(5, now=NOW)
    put(store, records)
    index = fresh(store)
    with store.writing("default", actor="test", now=NOW) as transaction:
        transaction.forget(records[0].id, why="asked to")
    index.refresh()
    assert records[0].id not in ids_of(index.candidates())
    same(index, store)


def test_programs_are_told_apart(store: Store) -> None:
    records = lessons(3, now=NOW)
    program = '{"kind":"program","skill":"pick","roles":{"theme":"cup"},"steps":[]}'
    put(
        store,
        [replace(records[0], effect=program), replace(records[1], effect='{"kind":"prior"}'), records[2]],
    )
    candidates = fresh(store).candidates()
    programs = dict(zip(ids_of(candidates), candidates.programs.tolist(), strict=True))
    assert programs == {records[0].id: True, records[1].id: False, records[2].id: False}


def test_vectors_of_another_model_or_damaged_are_made_anew(store: Store) -> None:
    records = lessons(6, now=NOW)
    put(store, records[:2], model="another-model")
    put(store, records[2:4], vectors=False)
    put(store, records[4:])
    index = fresh(store)
    expected = record_vectors(EMBEDDER, [(r.query, r.content) for r in records])
    for record, vector in zip(records, expected, strict=True):
        np.testing.assert_array_equal(index.vector(record.id), vector)


def test_dead_rows_go(store: Store) -> None:
    records = lessons(300, now=NOW)
    put(store, records)
    index = fresh(store)
    for turn in range(7):
        put(
            store,
            [replace(stored(store, r.id), content=f"turn {turn} of {r.content}") for r in records],
        )
        index.refresh()
        assert len(index._rows.records) <= 300 + 1024 + 150 + 300
    same(index, store)


def test_nearest_is_exact(store: Store) -> None:
    records = lessons(800, now=NOW)
    put(store, records)
    index = fresh(store)
    table = record_vectors(EMBEDDER, [(r.query, r.content) for r in records])
    for query in ("pick up the red cube", "öffne die linke Schublade", "拿起红色方块"):
        vector = EMBEDDER.embed([query])[0]
        near = index.nearest(vector, 10)
        expected = np.sort(table @ vector)[::-1][:10]
        np.testing.assert_allclose([cosine for _, cosine in near], expected, atol=1e-6)
        truth = {records[i].id for i in np.argsort(-(table @ vector), kind="stable")[:10]}
        assert {record.id for record, _ in near} == truth
    assert len(index.nearest(np.zeros(256, np.float32), 3)) == 0
    assert len(index.nearest(vector, 0)) == 0
    assert len(index.nearest(vector, 5000)) == 800


def test_an_empty_bank(store: Store) -> None:
    index = fresh(store)
    assert len(ids_of(index.candidates())) == 0
    assert index.candidates().lexical("cube").shape == (0,)
    assert index.candidates().cosine(EMBEDDER.embed(["cube"])[0]).shape == (0,)
    assert len(index.nearest(EMBEDDER.embed(["cube"])[0], 3)) == 0


def test_another_database_in_its_place_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "memory.db"
    with Store.open(f"sqlite:///{path}") as store:
        for seed in (1, 2, 3):
            put(store, lessons(5, seed, now=NOW))
        index = fresh(store)
        index.candidates()
        with Store.open(f"sqlite:///{tmp_path / 'other.db'}") as other:
            put(other, lessons(4, 9, now=NOW))
            index._store = other  # what a restored backup looks like from here: the same bank, an earlier rev
            index.refresh()
            same(index, other)
