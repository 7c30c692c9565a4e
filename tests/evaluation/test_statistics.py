import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from gvla2.evaluation.statistics import (
    exact_mcnemar,
    holm,
    mean_and_deviation,
    pooled_difference,
    relative_change,
    wilson_interval,
    won_and_lost,
)

WON, LOST, BOTH, NEITHER = (False, True), (True, False), (True, True), (False, False)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_contains_the_share_and_stays_in_bounds(case):
    successes, trials = case
    low, high = wilson_interval(successes, trials)
    same = binomtest(successes, trials).proportion_ci(method="wilson")
    assert (low, high) == pytest.approx((same.low, same.high), abs=1e-12)
    assert 0 <= low <= successes / trials + 1e-12
    assert successes / trials - 1e-12 <= high <= 1


def test_relative_change_covers_what_it_should():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(100):
        before = rng.uniform(10, 20, 30)
        change = relative_change(before, before * rng.normal(0.9, 0.1, 30), draws=400)
        covered += change.low <= -10 <= change.high
    assert 85 <= covered <= 100


@pytest.mark.parametrize(
    ("before", "after"), [([], []), ([1.0], [1.0, 2.0]), ([0.0], [1.0]), ([1.0], [float("nan")])]
)
def test_pairs_that_have_no_change(before, after):
    with pytest.raises(ValueError, match=r"Pairs are needed|must be finite"):
        relative_change(before, after)


def test_mean_and_deviation():
    assert mean_and_deviation([1.0, 3.0]) == (2.0, pytest.approx(2**0.5))
    assert mean_and_deviation([4.0]) == (4.0, 0.0)
    with pytest.raises(ValueError, match="at least one"):
        mean_and_deviation([])


def test_mcnemar_counts_discordant_pairs_alone():
    assert won_and_lost([WON, WON, LOST, BOTH, NEITHER]) == (2, 1)
    assert exact_mcnemar([BOTH, NEITHER] * 9) == 1.0
    assert exact_mcnemar([WON] * 6 + [BOTH] * 50) == pytest.approx(2 / 2**6), "equal pairs say nothing"
    assert exact_mcnemar([WON] * 5 + [LOST] * 5) == pytest.approx(1.0)


@given(st.dictionaries(st.text(max_size=3), st.floats(0, 1), max_size=8))
def test_holm_steps_down_and_never_lowers_a_p_value(values):
    assert holm({"a": 0.01, "b": 0.04, "c": 0.03}) == pytest.approx({"a": 0.03, "c": 0.06, "b": 0.06})
    adjusted = holm(values)
    assert adjusted.keys() == values.keys()
    assert all(values[name] <= adjusted[name] <= 1 for name in values)


def test_a_pooled_difference_weighs_tasks_alike_and_widens_with_their_disagreement():
    even = pooled_difference({"a": [WON] * 10 + [BOTH] * 10, "b": [WON] * 50 + [BOTH] * 50})
    assert even.value == pytest.approx(50)
    assert even.low < 50 < even.high
    assert even.count == 120
    torn = pooled_difference({"a": [WON] * 20, "b": [BOTH] * 100})
    assert torn.value == pytest.approx(50), "the larger task does not count for more"
    assert torn.high - torn.low > even.high - even.low
    with pytest.raises(ValueError, match="No pairs"):
        pooled_difference({"a": []})
