from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvla2.errors import PlanningError
from gvla2.planning.effects import Effect, apply_effects

THETA = {"lift_height": 0.25, "grasp_depth": 0.02}


def test_a_prior_pulls_by_its_count_and_a_bound_clamps_after_it():
    prior = Effect("prior", "lift_height", 0.35, count=2, source="r1")
    bound = Effect("bound", "lift_height", 0.28, "<=", source="r2")
    changed, notes = apply_effects(THETA, [bound, prior], "pick")
    assert changed["lift_height"] == pytest.approx(0.28)  # 0.25 -> 0.30 by the prior, then bounded
    assert ["r1" in notes[0], "r2" in notes[1]] == [True, True]
    assert THETA == {"lift_height": 0.25, "grasp_depth": 0.02}


def test_effects_of_other_skills_or_unknown_parameters_change_nothing():
    others = [Effect("bound", "lift_height", 0.5, skill="push"), Effect("bound", "twist_angle", 1.0),
              Effect("prior", "lift_height", 0.5, count=0), Effect("forbid", "lift_height")]  # fmt: skip
    assert apply_effects(THETA, others, "pick") == (THETA, [])


@given(st.floats(-1, 1), st.floats(-1, 1), st.sampled_from([">=", "<="]), st.integers(0, 50))
def test_a_bound_holds_whatever_experience_says(limit, mean, op, count):
    effects = [Effect("bound", "lift_height", limit, op), Effect("prior", "lift_height", mean, count=count)]
    value = apply_effects(THETA, effects, "pick")[0]["lift_height"]
    assert value >= limit if op == ">=" else value <= limit


def test_effects_survive_json_and_bad_ones_are_refused():
    effect = Effect("bound", "grasp_depth", 0.03, ">=", skill="pick", source="r9")
    assert Effect.from_json(effect.to_json()) == effect
    assert Effect.from_json(effect.to_json(), source="other").source == "other"
    for bad in (
        {"kind": "bound"},
        {"kind": "wish", "parameter": "x"},
        {"kind": "bound", "parameter": "x", "op": "<"},
        {"kind": "bound", "parameter": "x"},
        {"kind": "bound", "parameter": "x", "op": ">="},
        {"kind": "bound", "parameter": "x", "value": 0.2},
        {"kind": "bound", "parameter": "x", "op": ">=", "value": float("nan")},
        {"kind": "bound", "parameter": "x", "op": ">=", "value": "much"},
        {"kind": "prior", "parameter": "x", "value": 0.2},
        {"kind": "prior", "parameter": "x", "count": 2},
    ):
        with pytest.raises(PlanningError, match="Not a parameter effect"):
            Effect.from_json(bad)
    assert Effect.from_json({"kind": "forbid", "parameter": "approach:top"}).kind == "forbid"
