"""Texts that share most of their words are found among many, and nothing else is."""

import random

import numpy as np

from gvla2.memory.curation.likeness import jaccard
from gvla2.memory.curation.resemblance import CROWD, resembling


def texts(count: int, seed: int) -> list[frozenset[str]]:
    rng = random.Random(seed)
    words = [f"w{i}" for i in range(60)]
    made = [frozenset(rng.sample(words, rng.randint(0, 9))) for _ in range(count)]
    near = [frozenset([*sorted(text)[1:], rng.choice(words)]) for text in made[: count // 2]]
    return made + near


def test_what_is_found_is_alike_and_of_the_same_kind() -> None:
    said = texts(200, 1)
    kinds = [i % 3 for i in range(len(said))]
    found, counts = resembling(said, kinds, 0.5)
    alike = 0
    for i, text in enumerate(said):
        others = found[i, : counts[i]].tolist()
        assert len(set(others)) == len(others)
        assert i not in others
        for other in others:
            assert kinds[other] == kinds[i]
            assert jaccard(text, said[other]) >= 0.5
        alike += sum(
            kinds[j] == kinds[i] and jaccard(text, other) >= 2 / 3
            for j, other in enumerate(said)
            if j != i and text
        )
    close = sum(
        jaccard(said[i], said[j]) >= 2 / 3
        for i in range(len(said))
        for j in found[i, : counts[i]].tolist()
        if said[i]
    )
    assert close >= 0.8 * alike > 0


def test_equal_texts_are_always_found_but_for_a_crowd() -> None:
    said = [frozenset({"grip", "handle", "mug"})] * 3 + [frozenset({"salt", "soup"})]
    found, counts = resembling(said, [""] * 4, 0.5)
    assert [sorted(row[:n].tolist()) for row, n in zip(found, counts, strict=True)] == [
        [1, 2],
        [0, 2],
        [0, 1],
        [],
    ]
    _, many = resembling([frozenset({"a", "b"})] * 100, [0] * 100, 0.5)
    assert many.max() == CROWD


def test_nothing_and_empty_texts_are_like_nothing() -> None:
    found, counts = resembling([], [], 0.5)
    assert found.shape == (0, 64)
    assert counts.shape == (0,)
    _, counts = resembling([frozenset()] * 3, [0] * 3, 0.5)
    assert not np.any(counts)
