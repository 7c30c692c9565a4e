"""Looks of things, and whose lessons count for them."""

import numpy as np

from gvla2.geometry.transform import rigid
from gvla2.planning.effects import Bound, Effect, effect_from_json, look_of, own_first
from gvla2.planning.scene import Box, Scene, SceneObject


def thing(id_: str, colour: str, parent: str = "") -> SceneObject:
    return SceneObject(
        id_, f"{colour} thing", "box", colour, rigid(), np.ones(3), np.zeros((0, 3)), parent=parent
    )


def scene(*things: SceneObject) -> Scene:
    return Scene(things, 0.75, Box(-np.ones(3), np.ones(3)))


def turn(value: float, thing: str = "", skill: str = "twist", parameter: str = "turn") -> Effect:
    return Bound(parameter, value, ">=", skill=skill, object=thing)


def test_a_part_looks_like_itself_on_its_whole():
    jar, lid = thing("jar", "red"), thing("lid", "gray", parent="jar")
    assert look_of(jar, scene(jar, lid)) == "red"
    assert look_of(lid, scene(jar, lid)) == "gray on red"
    assert look_of(None, scene()) == ""
    assert look_of(thing("x", ""), scene()) == "", "unsure of the colour: it looks like nothing in particular"
    knob = thing("knob", "blue", parent="lid")
    assert look_of(knob, scene(jar, lid, knob)) == "blue on red", "the whole, however deep the part"
    one, other = thing("a", "red", parent="b"), thing("b", "blue", parent="a")
    assert look_of(one, scene(one, other)) == "red on blue", "parents in a ring come to an end"


def test_what_was_learnt_on_its_like_replaces_what_was_learnt_on_others():
    own, other, any_ = turn(3.0, "gray on red"), turn(5.0, "gray on blue"), turn(1.0)
    assert own_first([other, own, any_], "gray on red") == (own, any_)
    assert own_first([other, own, any_], "gray on lime") == (other, own, any_), (
        "nothing of its own: all count"
    )
    assert own_first([other, own], "") == (other, own), "it looks like nothing in particular"


def test_other_parameters_and_skills_of_others_stay():
    own = turn(3.0, "red")
    depth, push = turn(0.1, "blue", parameter="grasp_depth"), turn(0.2, "blue", skill="push")
    assert own_first([own, depth, push], "red") == (own, depth, push)


def test_the_look_survives_json_and_is_left_out_where_there_is_none():
    assert effect_from_json(turn(3.0, "red").to_json()).object == "red"
    assert "object" not in turn(3.0).to_json()
