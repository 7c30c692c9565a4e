import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from gvla2.evaluation.statistics import mean_and_deviation, paired_change, wilson_interval


def test_known_value():
    low, high = wilson_interval(18, 20)
    assert (low, high) == (pytest.approx(0.699, abs=1e-3), pytest.approx(0.972, abs=1e-3))


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_contains_the_share_and_stays_in_bounds(case):
    successes, trials = case
    low, high = wilson_interval(successes, trials)
    same = binomtest(successes, trials).proportion_ci(method="wilson")
    assert (low, high) == pytest.approx((same.low, same.high), abs=1e-12)
    assert 0 <= low <= successes / trials + 1e-12
    assert successes / trials - 1e-12 <= high <= 1


@pytest.mark.parametrize(("successes", "trials"), [(1, 0), (-1, 3), (4, 3)])
def test_nonsense_is_refused(successes, trials):
    with pytest.raises(ValueError, match="not a proportion"):
        wilson_interval(successes, trials)


def test_paired_change_of_a_uniform_gain_has_no_spread():
    change = paired_change([1.0, 20.0, 300.0], [0.5, 10.0, 150.0])
    assert (change.percent, change.low, change.high, change.count) == pytest.approx((-50, -50, -50, 3))


def test_paired_change_covers_what_it_should():
    rng = np.random.default_rng(0)
    covered = 0
    for trial in range(100):
        before = rng.uniform(10, 20, 30)
        change = paired_change(before, before * rng.normal(0.9, 0.1, 30), draws=400, seed=trial)
        covered += change.low <= -10 <= change.high
    assert 85 <= covered <= 100


@pytest.mark.parametrize(
    ("before", "after"), [([], []), ([1.0], [1.0, 2.0]), ([0.0], [1.0]), ([1.0], [float("nan")])]
)
def test_pairs_that_have_no_change(before, after):
    with pytest.raises(ValueError, match=r"Pairs are needed|must be finite"):
        paired_change(before, after)


def test_mean_and_deviation():
    assert mean_and_deviation([1.0, 3.0]) == (2.0, pytest.approx(2**0.5))
    assert mean_and_deviation([4.0]) == (4.0, 0.0)
    with pytest.raises(ValueError, match="No values"):
        mean_and_deviation([])
