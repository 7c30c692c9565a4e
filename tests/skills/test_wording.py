"""What people call things otherwise is put into the words of the scene; what is not there stays as it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.skills.wording import in_scene_words


def scene(*labels):
    """Things in a row by their labels, the first word of which is the colour."""
    things = [
        SceneObject(
            f"o{i}", label, "box", label.split()[0], rigid(translation=(0.3, 0.1 * i, 0.8)), np.full(3, 0.05),
            np.zeros((0, 3)),
        )
        for i, label in enumerate(labels)
    ]  # fmt: skip
    return Scene(tuple(things), 0.75, Box(np.array([-0.3, -0.7, 0.75]), np.array([0.8, 0.7, 1.7])))


@pytest.mark.parametrize(
    ("wish", "labels", "told"),
    [
        ("Fill the goblet.", ("white cup",), "Fill the cup."),
        ("Hand me the pink tumbler.", ("magenta cup", "white bowl"), "Hand me the magenta cup."),
        (
            "Lift the grey canister, please.",
            ("gray cylinder", "white cup"),
            "Lift the gray cylinder, please.",
        ),
        ("Close the hatch of the crate", ("navy lid", "red open box"), "Close the lid of the open box"),
        ("Take the blade from the knife rack", ("green knife", "olive knife block"), None),
        ("Lift the beakers", ("white cup", "red cup"), "Lift the cup"),
    ],
)
def test_the_scenes_own_words_take_the_place_of_others(wish, labels, told):
    expected = told or "Take the knife from the knife block"
    assert in_scene_words(wish, scene(*labels)) == expected


@pytest.mark.parametrize(
    ("wish", "labels"),
    [
        ("Lift the banana.", ("yellow bottle", "gray tray")),  # looks like nothing that is there
        ("Lift the green goblet.", ("white cup",)),  # of another colour
        ("Lift the carton.", ("green box", "yellow bottle")),  # may be either
        ("Lift the cup.", ("white cup", "azure cylinder")),  # is called so already
        ("Put it on the cube at the top", ("red cube", "navy lid")),  # a place
        ("Take the part that covers it", ("navy lid",)),  # a verb
        ("Pot the plant", ("yellow jar",)),  # no article, no noun
        ("", ("yellow jar",)),
    ],
)
def test_what_is_not_told_stays(wish, labels):
    assert in_scene_words(wish, scene(*labels)) == wish


@given(st.text(max_size=80))
def test_any_text_is_taken(wish):
    assert isinstance(
        in_scene_words(f"{wish} the İßcup the red red knife stand", scene("red cup", "navy knife block")), str
    )


def test_a_phrase_of_several_nouns_is_told_once():
    where = scene("navy knife block", "white plate")
    assert in_scene_words("Lift the blue knife block.", where) == "Lift the navy knife block."
    assert in_scene_words("Lift the blue knife rack.", where) == "Lift the navy knife block."
