"""Wishes as a whole: what no skill does, and how many calls they may take."""

import pytest

from gvla2.programs.wishes import MOST, acting, most_calls, undoable
from gvla2.testing import inputs

SCENE = inputs.scene()


@pytest.mark.parametrize(
    ("wish", "verb"),
    [
        ("please pour me some tea", "pour"), ("could you unfold the umbrella", "unfold"),
        ("lift the cup so that I can wipe the table", ""), ("fold the lid down", ""), ("lift it and throw it", "throw"),
        ("switch the lamp off", "switch the lamp"), ("put the lamp on", ""), ("fold the mat in half", "in half"),
        ("put it in the half-open box", ""),
    ],
)  # fmt: skip
def test_a_verb_that_no_skill_is_for(wish, verb):
    assert undoable(wish) == verb


@pytest.mark.parametrize(
    ("wish", "most"),
    [
        ("lift the red cube", 1), ("open the jar and put its lid on the tray", 2), ("put all of it away", MOST),
        ("lift the cubes", MOST), ("first the red cube, then the blue one", 4),
    ],
)  # fmt: skip
def test_no_more_calls_than_the_wish_has_parts(wish, most):
    assert most_calls(wish, SCENE) == most


@pytest.mark.parametrize(
    ("wish", "why"),
    [
        ("Hold both cups up at the same time.", "both cups up at the same time"),
        ("Saw the cube in half.", "saw"),
        ("Pick up both cups.", ""),
    ],
)
def test_what_one_hand_cannot_do_is_told(wish, why):
    assert undoable(wish) == why


@pytest.mark.parametrize(
    ("wish", "is_act"),
    [
        ("Scrub the toilet bowl.", False),
        ("Slice the bread on the board.", False),
        ("Grabbing the cup would be nice.", True),
        ("The cube placed on the plate, please.", True),
        ("Red thing up off the table.", True),
    ],
)
def test_a_wish_without_any_act_is_told(wish, is_act):
    assert acting(wish) == is_act
