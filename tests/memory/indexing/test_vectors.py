"""Quantised vectors in blocks: near to within what they promise, through growth, changes, compaction and a copy."""

import numpy as np
import pytest

import gvla2.memory.indexing.vectors as module
from gvla2.errors import ConfigurationError
from gvla2.memory.indexing.vectors import Vectors


def units(count: int, dimension: int, seed: int, share: float = 1.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, dimension)) * (rng.random((count, dimension)) < share)
    return (rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)).astype(np.float32)


def check(vectors: Vectors, expected: np.ndarray, seed: int) -> None:
    queries = np.concatenate([units(3, expected.shape[1], seed), units(3, expected.shape[1], seed, 0.1)])
    for query in [*queries, expected[-1], np.zeros_like(queries[0])]:
        true = expected.astype(np.float64) @ query
        near = vectors.near(query, len(expected))
        assert np.abs(near - true).max() <= vectors.slack(query)
        assert vectors.slack(query) < 0.05
        rows = np.arange(0, len(expected), 3)
        np.testing.assert_allclose(vectors.cosines(query, rows), true[rows], atol=1e-6)


@pytest.mark.parametrize("block", [16, 64, 4096])
@pytest.mark.parametrize("dimension", [7, 64])
def test_what_was_put_is_found(monkeypatch: pytest.MonkeyPatch, block: int, dimension: int) -> None:
    monkeypatch.setattr(module, "BLOCK", block)
    monkeypatch.setattr(module, "_FEW", min(8, block))
    rows = units(300, dimension, 1)
    rows[[4, 70]] = 0.0
    vectors = Vectors(dimension)
    done = 0
    for count in (1, 1, 5, 40, 1, 100, 152):
        if count == 1:
            vectors.slack(rows[done])  # what is asked for first is stored with the same codes
        vectors.put(done, rows[done : done + count])
        done += count
        check(vectors, rows[:done], done)
    rows[17] = rows[200]
    vectors.put(17, rows[17:18])
    check(vectors, rows, 9)
    copy = Vectors.restored(
        {name: array.copy() for name, array in vectors.arrays(300).items()}, vectors.error
    )
    check(copy, rows, 10)
    kept = np.flatnonzero(np.arange(300) % 3 > 0)
    for either in (vectors, copy):
        either.compact(kept)
        check(either, rows[kept], 11)
        either.put(200, rows[:50])
        check(either, np.concatenate([rows[kept], rows[:50]]), 12)


def test_a_row_has_the_same_cosine_beside_any_others() -> None:
    rows = np.repeat(units(1, 512, 3), 41, axis=0)
    vectors = Vectors(512)
    vectors.put(0, rows)
    found = vectors.cosines(units(1, 512, 4)[0], np.arange(41))
    assert len(set(found.tolist())) == 1


def test_what_does_not_fit_is_refused() -> None:
    vectors = Vectors(16)
    vectors.put(0, units(3, 16, 5))
    for wrong in (np.zeros(15, np.float32), np.zeros((1, 16), np.float32)):
        with pytest.raises(ConfigurationError, match="vectors of 16 numbers"):
            vectors.near(wrong, 3)
        with pytest.raises(ConfigurationError, match="vectors of 16 numbers"):
            vectors.cosines(wrong, np.array([0]))
    for row in (-1, 10_000):
        with pytest.raises(IndexError):
            vectors.cosines(units(1, 16, 6)[0], np.array([row]))
