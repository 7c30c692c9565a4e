"""Misreading: calls that act on something else than the wish speaks of."""

from dataclasses import replace

import pytest

from gvla2.planning.calls import SkillCall
from gvla2.programs.misreading import misread, onto_itself
from gvla2.testing import inputs

SCENE = inputs.scene()
RED, BLUE = SCENE.objects
TRAY = replace(BLUE, id="tray", label="gray tray", colour="gray")
THREE = replace(SCENE, objects=(RED, BLUE, TRAY))


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


def test_a_painted_patch_is_never_what_is_moved():
    patched = replace(THREE, objects=(RED, BLUE, replace(TRAY, shape="region")))
    call = SkillCall("place", "red_cube", "tray")
    assert not misread([call], "see the tray there? put the red cube onto it", patched)[0]
    assert misread([call], "see the tray there? put the red cube onto it", THREE)[0]


def test_what_goes_onto_itself_is_told():
    assert onto_itself("put the small red cube on top of the big red cube", THREE) == "red cube"
    assert not onto_itself("put the red cube on top of the blue cube", THREE)
    assert not onto_itself("put the cube on the other cube", THREE)
