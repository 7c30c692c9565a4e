"""Mentions: what a wish speaks of, and where calls act on something else."""

from dataclasses import replace

import pytest

from gvla2.planning.calls import SkillCall
from gvla2.skills.mentions import MOST, acting, mentions, misread, most_calls, onto_itself, undoable
from gvla2.testing import inputs

SCENE = inputs.scene()
RED, BLUE = SCENE.objects
TRAY = replace(BLUE, id="tray", label="gray tray", colour="gray")
THREE = replace(SCENE, objects=(RED, BLUE, TRAY))


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ("put the red cube on the blue cube", [("red_cube", ""), ("blue_cube", "on")]),
        ("from the tray take the blue one", [("tray", "from"), ("blue_cube", "")]),
        ("lift it out of the tray", [("tray", "from")]),
        ("put the red cube on top of the gray tray", [("red_cube", ""), ("tray", "onto")]),
        ("lift the red cube without touching the blue cube", [("red_cube", "")]),
        ("lift the pineapple", []),
    ],
)
def test_mentions_in_their_order_with_what_stands_before_them(wish, said):
    assert [(next(iter(m.roots)), m.after) for m in mentions(wish, THREE)] == said


@pytest.mark.parametrize(
    ("call", "wish", "sound"),
    [
        (SkillCall("place", "red_cube", "tray"), "put the red cube into the tray", True),
        (SkillCall("place", "tray", "red_cube"), "put the red cube into the tray", False),
        (SkillCall("pick", "tray"), "get that thing out of the tray", False),
        (SkillCall("pick", "red_cube"), "get that thing out of the tray", True),
        (SkillCall("pick", "red_cube"), "get me something", True),
    ],
)
def test_what_is_acted_on_is_what_the_wish_says(call, wish, sound):
    why, wanted = misread([call], wish, THREE)
    assert (why == "") == sound
    assert call.theme not in wanted


def test_what_goes_on_about_it_acts_on_nothing_else():
    calls = [SkillCall("pick", "red_cube"), SkillCall("push", "blue_cube", "tray")]
    assert misread(calls, "take the red cube and lift it", THREE)[0]
    assert not misread(calls, "take the red cube and push the blue cube to the tray", THREE)[0]


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


def test_a_painted_patch_is_never_what_is_moved():
    patched = replace(THREE, objects=(RED, BLUE, replace(TRAY, shape="region")))
    call = SkillCall("place", "red_cube", "tray")
    assert not misread([call], "see the tray there? put the red cube onto it", patched)[0]
    assert misread([call], "see the tray there? put the red cube onto it", THREE)[0]


def test_what_goes_onto_itself_is_told():
    assert onto_itself("put the small red cube on top of the big red cube", THREE) == "red cube"
    assert not onto_itself("put the red cube on top of the blue cube", THREE)
    assert not onto_itself("put the cube on the other cube", THREE)
