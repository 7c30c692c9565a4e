"""Faithfulness: what a wish names and a program leaves out."""

from dataclasses import replace

import pytest

from gvla2.planning.calls import SkillCall
from gvla2.planning.scene_brief import unique_names
from gvla2.programs.faithful import beyond, colour_absent, doubts, ruled_out, unclear
from gvla2.testing import inputs

SCENE = inputs.scene()
RED, BLUE = SCENE.objects
STACK = (SkillCall("place", "red_cube", "blue_cube", relation="on"),)
PICK = (SkillCall("pick", "red_cube"),)


def with_blue_as(colour, label=""):
    return replace(SCENE, objects=(RED, replace(BLUE, colour=colour, label=label or f"{colour} cube")))


def three():
    return replace(
        SCENE, objects=(*SCENE.objects, replace(BLUE, id="third", colour="green", label="green cube"))
    )


@pytest.mark.parametrize(
    ("calls", "wish", "faithful"),
    [
        (STACK, "put the red cube on the blue cube", True),
        (STACK, "put the blue cube on the red cube", False),
        (PICK, "put the red cube on the blue cube", False),
        (PICK, "lift the red cube", True),
        (PICK, "push the red cube", False),
        (PICK, "lift the blue cube", False),
        (PICK, "lift something", True),
        (PICK, "lift the red cube behind the blue cube", True),
    ],
)
def test_doubts_are_about_what_no_call_is_about(calls, wish, faithful):
    assert (doubts(calls, wish, SCENE, unique_names(SCENE)) == []) == faithful


def test_a_shade_is_what_the_basic_term_means():
    scene = with_blue_as("azure")
    names = unique_names(scene)
    assert doubts((SkillCall("pick", "blue_cube"),), "lift the blue cube", scene, names) == []
    found = doubts(PICK, "lift the light blue cube", scene, names)
    assert found
    assert all(doubt.about == {"azure_cube"} for doubt in found)


@pytest.mark.parametrize(
    ("wish", "colour"),
    [
        ("lift the green cube", "green"), ("lift the red cube", ""), ("lift the cube", ""),
        ("take the pink one", "pink"),
        ("lift the dark blue cube", "dark blue"), ("hundred cubes", ""),
    ],
)  # fmt: skip
def test_a_colour_that_nothing_can_mean(wish, colour):
    assert colour_absent(wish, SCENE) == colour
    assert colour_absent(wish, with_blue_as("")) == ""  # who knows


def test_a_colour_that_a_label_says_or_a_shade_bears_is_there():
    assert colour_absent("lift the orange", with_blue_as("red", "orange juice")) == ""
    assert colour_absent("lift the blue cube", with_blue_as("navy")) == ""
    assert colour_absent("lift the navy cube", with_blue_as("blue")) == "navy"


@pytest.mark.parametrize(
    ("calls", "wish", "scene", "clear"),
    [
        (STACK, "put the red cube on the blue cube", SCENE, True),
        (PICK, "lift the cube", SCENE, False),
        (PICK, "lift the left cube", SCENE, True),
        (STACK, "put the cube on the blue cube", SCENE, True),
        (STACK, "put the cube on the blue cube", three(), False),
        (PICK, "lift it", SCENE, True),
        (PICK, "lift the red cube", with_blue_as("red"), False),
    ],
)
def test_several_of_a_kind_are_unclear_without_a_word_that_tells_them_apart(calls, wish, scene, clear):
    assert (unclear(calls, wish, scene) == "") == clear


def test_words_that_rule_out():
    assert ruled_out("Lift it, but don't drop it") == "but"
    assert ruled_out("Lift the knot") == ""


def test_what_only_the_speaker_sees_and_what_is_not_there_twice_is_not_asked():
    assert beyond("take the cube on my left", SCENE).kind == "ambiguous"
    assert beyond("put the red cube on top of the tall red cube", SCENE).kind == "nothing_matches"
    assert beyond("put the red cube on top of the blue cube", SCENE) is None


@pytest.mark.parametrize(
    ("wish", "names"),
    [
        ("Take up those carrots for the stew.", False), ("Turn the radio on.", False), ("Pick the scissors up", False),
        ("Lift the dice", True), ("Lift both cubes", True), ("Grab it!", True), ("Take the crimson one", True),
    ],
)  # fmt: skip
def test_a_wish_that_names_nothing_of_the_scene_is_not_for_a_model(wish, names):
    refusal = beyond(wish, SCENE)
    assert (refusal is None) is names
    assert names or refusal.kind == "nothing_matches"
