"""Exact order from scores that are known nearly, whatever blocks it is looked for in."""

from functools import partial

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.retrieval.kernels import largest
from gvla2.memory.retrieval.ranking import best, best_first, blocks_in_order


@given(st.integers(0, 10_000), st.integers(0, 90), st.sampled_from([0.0, 0.05, 3.0]), st.integers(1, 40))
@settings(max_examples=150, deadline=None)
def test_the_order_is_that_of_all_exact_scores(seed: int, count: int, slack: float, block: int) -> None:
    rng = np.random.default_rng(seed)
    # Few different values, so that there are ties, and some rows that don't count.
    exact = np.round(rng.normal(size=count), 1)
    near = exact + rng.uniform(-slack, slack, count)
    exact[rng.random(count) < 0.2] = -np.inf
    near[(exact == -np.inf) & (rng.random(count) < 0.5)] = -np.inf
    ids = [f"id-{i}" for i in rng.permutation(count)]
    expected = sorted(
        (row for row in range(count) if exact[row] > -np.inf), key=lambda row: (-exact[row], ids[row])
    )
    nearly = partial(largest, near)
    found = list(best_first(nearly, slack + 1e-12, lambda rows: exact[rows], ids, block=block))
    assert [row for row, _ in found] == expected
    assert [score for _, score in found] == exact[expected].tolist()
    for wanted in (0, 1, 5, 90):
        rows, scores = best(nearly, slack + 1e-12, lambda rows: exact[rows], ids, wanted)
        assert rows.tolist() == expected[:wanted]
        assert scores.tolist() == exact[expected[:wanted]].tolist()


def test_no_more_is_scored_than_the_order_needs() -> None:
    near = np.random.default_rng(1).random(5000)
    asked: list[int] = []

    def exact(rows: np.ndarray) -> np.ndarray:
        asked.append(len(rows))
        return near[rows]

    rows, _ = next(blocks_in_order(partial(largest, near), 1e-9, exact, [str(i) for i in range(5000)]))
    assert rows[0] == int(np.argmax(near))
    assert asked == [32]


def test_the_largest_with_their_equals_and_all_where_there_are_fewer() -> None:
    values = np.array([0.5, 2.0, -np.inf, 1.0, 1.0, -3.0])
    places, least = largest(values, 2)
    assert (places.tolist(), least) == ([1, 3, 4], 1.0)
    places, least = largest(values, 6)
    assert (places.tolist(), least) == ([0, 1, 3, 4, 5], -np.inf)
    assert largest(values[:0], 3)[0].shape == (0,)
