from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvla2.errors import PlanningError
from gvla2.geometry.transform import rigid
from gvla2.planning.effects import (
    Ban,
    Bound,
    Prior,
    apply_effects,
    as_shares,
    effect_from_json,
    look_of,
    own_first,
    reconciled,
)
from gvla2.planning.scene import Box, Scene, SceneObject

THETA = {"lift_height": 0.25, "grasp_depth": 0.02}


def test_a_prior_pulls_by_its_count_and_a_bound_clamps_after_it():
    prior = Prior("lift_height", 0.35, count=2, source="r1")
    bound = Bound("lift_height", 0.28, "<=", source="r2")
    changed, notes = apply_effects(THETA, [bound, prior], "pick")
    assert changed["lift_height"] == pytest.approx(0.28)  # 0.25 -> 0.30 by the prior, then bounded
    assert ["r1" in notes[0], "r2" in notes[1]] == [True, True]
    assert THETA == {"lift_height": 0.25, "grasp_depth": 0.02}


def test_effects_of_other_skills_or_unknown_parameters_change_nothing():
    others = [Bound("lift_height", 0.5, skill="push"), Bound("twist_angle", 1.0),
              Prior("lift_height", 0.5, count=0), Ban("lift_height")]  # fmt: skip
    assert apply_effects(THETA, others, "pick") == (THETA, [])


@given(st.floats(-1, 1), st.floats(-1, 1), st.sampled_from([">=", "<="]), st.integers(0, 50))
def test_a_bound_holds_whatever_experience_says(limit, mean, op, count):
    effects = [Bound("lift_height", limit, op), Prior("lift_height", mean, count=count)]
    value = apply_effects(THETA, effects, "pick")[0]["lift_height"]
    assert value >= limit if op == ">=" else value <= limit


def test_effects_survive_json_and_bad_ones_are_refused():
    effect = Bound("grasp_depth", 0.03, ">=", skill="pick", source="r9")
    others = (
        Prior("x", 0.5, 3, 0.1, scale="height", object="red"),
        Ban("approach:top"),
    )
    for one in (effect, *others):
        assert effect_from_json(one.to_json()) == one
    assert effect_from_json(effect.to_json(), source="other").source == "other"
    assert "object" not in effect.to_json()
    for bad in (
        {"kind": "bound"},
        {"kind": "wish", "parameter": "x"},
        {"kind": "bound", "parameter": "x", "op": "<"},
        {"kind": "bound", "parameter": "x", "op": ">="},
        {"kind": "bound", "parameter": "x", "op": ">=", "value": float("nan")},
        {"kind": "bound", "parameter": "x", "op": ">=", "value": "much"},
        {"kind": "prior", "parameter": "x", "count": 2},
        {"kind": "prior", "parameter": 3, "value": 1.0, "count": 2},
    ):
        with pytest.raises(PlanningError, match="Not a parameter effect"):
            effect_from_json(bad)


def test_a_share_of_a_side_holds_for_other_sizes():
    learned = as_shares(Prior("grasp_depth", 0.025, sd=0.002, count=2), {"grasp_depth": ("height", 0.05)})
    assert isinstance(learned, Prior)
    assert (learned.value, learned.sd, learned.scale) == (pytest.approx(0.5), pytest.approx(0.04), "height")
    for height in (0.04, 0.05, 0.08):
        changed, _ = apply_effects(THETA, [learned], "pick", lengths={"height": height})
        assert changed["grasp_depth"] == pytest.approx(0.02 + 0.5 * (0.5 * height - 0.02))
    tight = Bound("grasp_depth", 0.6, ">=", scale="height", source="r3")
    changed, notes = apply_effects(THETA, [tight], "pick", lengths={"height": 0.1})
    assert changed["grasp_depth"] == pytest.approx(0.06)
    assert "r3" in notes[0]


def test_a_share_of_an_unknown_side_changes_nothing_and_says_so():
    share = Bound("grasp_depth", 0.6, scale="width", source="r4")
    assert share.absolute({"height": 0.1}) is None
    changed, notes = apply_effects(THETA, [share], "pick", lengths={"height": 0.1, "width": 0.0})
    assert changed == THETA
    assert "r4 was ignored" in notes[0]
    once = as_shares(share, {"grasp_depth": ("height", 0.1)})
    assert once == share


def test_bounds_that_exclude_each_other_give_way_to_a_success_or_are_left_out():
    def bound(op, value, **rest):
        return Bound("press_depth", value, op, skill="press", **rest)

    success = Prior("press_depth", 0.67, count=1, skill="press")
    assert reconciled([bound(">=", 0.70), bound("<=", 0.50), success]) == (
        bound(">=", 0.67), bound("<=", 0.67), success,
    )  # fmt: skip
    assert reconciled([bound(">=", 0.60), bound("<=", 0.80), success]) == (
        bound(">=", 0.60), bound("<=", 0.80), success,
    )  # fmt: skip
    assert reconciled([bound(">=", 0.70), success]) == (bound(">=", 0.70), success)
    other = bound("<=", 0.40, object="red")
    assert reconciled([bound(">=", 0.70), bound("<=", 0.50), bound("<=", 0.90), other]) == (
        bound("<=", 0.90), other,
    )  # fmt: skip


def make_object(id_: str, colour: str, parent: str = "") -> SceneObject:
    return SceneObject(
        id_, f"{colour} object", "box", colour, rigid(), np.ones(3), np.zeros((0, 3)), parent=parent
    )


def scene(*objects: SceneObject) -> Scene:
    return Scene(objects, 0.75, Box(-np.ones(3), np.ones(3)))


def turn(value: float, obj: str = "") -> Bound:
    return Bound("turn", value, ">=", skill="twist", object=obj)


def test_a_part_looks_like_itself_on_its_whole():
    jar, lid = make_object("jar", "red"), make_object("lid", "gray", parent="jar")
    assert look_of(jar, scene(jar, lid)) == "red"
    assert look_of(lid, scene(jar, lid)) == "gray on red"
    assert look_of(None, scene()) == ""
    assert look_of(make_object("x", ""), scene()) == "", "unsure of the colour"
    knob = make_object("knob", "blue", parent="lid")
    assert look_of(knob, scene(jar, lid, knob)) == "blue on red", "the whole, however deep the part"
    one, other = make_object("a", "red", parent="b"), make_object("b", "blue", parent="a")
    assert look_of(one, scene(one, other)) == "red on blue", "parents in a ring come to an end"


def test_what_was_learned_on_its_like_replaces_what_was_learned_on_others():
    own, other, any_ = turn(3.0, "gray on red"), turn(5.0, "gray on blue"), turn(1.0)
    assert own_first([other, own, any_], "gray on red") == (own, any_)
    assert own_first([other, own, any_], "gray on lime") == (other, own, any_), (
        "nothing of its own: all count"
    )
