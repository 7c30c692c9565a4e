"""Paired statistics against cases that can be worked out by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvla2.evaluation.paired import exact_mcnemar, holm, pooled_difference, won_and_lost

WON, LOST, BOTH, NEITHER = (False, True), (True, False), (True, True), (False, False)


def test_mcnemar_counts_discordant_pairs_alone():
    assert won_and_lost([WON, WON, LOST, BOTH, NEITHER]) == (2, 1)
    assert exact_mcnemar([BOTH, NEITHER] * 9) == 1.0
    assert exact_mcnemar([WON] * 6) == pytest.approx(2 / 2**6)
    assert exact_mcnemar([WON] * 6 + [BOTH] * 50) == pytest.approx(2 / 2**6), "equal pairs tell nothing"
    assert exact_mcnemar([WON] * 5 + [LOST] * 5) == pytest.approx(1.0)


def test_holm_steps_down_and_stays_monotone():
    assert holm({"a": 0.01, "b": 0.04, "c": 0.03}) == pytest.approx({"a": 0.03, "c": 0.06, "b": 0.06})
    assert holm({"a": 0.9, "b": 0.8}) == {"a": 1.0, "b": 1.0}
    assert holm({}) == {}


@given(st.dictionaries(st.text(max_size=3), st.floats(0, 1), max_size=8))
def test_holm_never_lowers_a_p_value(values):
    adjusted = holm(values)
    assert adjusted.keys() == values.keys()
    assert all(values[name] <= adjusted[name] <= 1 for name in values)


def test_a_pooled_difference_weighs_tasks_alike_and_widens_with_their_disagreement():
    even = pooled_difference({"a": [WON] * 10 + [BOTH] * 10, "b": [WON] * 50 + [BOTH] * 50})
    assert even.points == pytest.approx(50)
    assert even.low < 50 < even.high
    assert (even.tasks, even.pairs) == (2, 120)
    torn = pooled_difference({"a": [WON] * 20, "b": [BOTH] * 100})
    assert torn.points == pytest.approx(50), "the larger task does not count for more"
    assert torn.high - torn.low > even.high - even.low
    assert pooled_difference({"a": [LOST] * 4}).points == -100
    with pytest.raises(ValueError, match="No pairs"):
        pooled_difference({"a": []})
