"""Colours in phrases: of parts and their owners, and of things that are between two colour words."""

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2_plugins.skill.grounding import Grounded, ground
from gvla2_plugins.skill.phrases import read_phrase


def thing(name, label, shape, at, rgb, parent=""):
    colour = label.split()[0]
    pose = rigid(translation=(*at, 0.8))
    return SceneObject(
        name, label, shape, colour, pose, np.full(3, 0.06), np.zeros((0, 3)), np.array(rgb), parent
    )


def scene(*things):
    return Scene(things, 0.752, Box(np.array([-0.3, -0.7, 0.75]), np.array([0.8, 0.7, 1.7])))


def jars(lid="gray", rgb=(0.55, 0.57, 0.6)):
    return scene(
        thing("a", "orange jar", "cylinder", (0.2, 0.1), (1.0, 0.5, 0.0)),
        thing("b", f"{lid} lid", "disc", (0.2, 0.1), rgb, "a"),
        thing("c", "silver jar", "cylinder", (0.2, -0.2), (0.75, 0.75, 0.75)),
        thing("d", f"{lid} lid", "disc", (0.2, -0.2), rgb, "c"),
    )


@pytest.mark.parametrize(("words", "meant"), [("the orange lid", "b"), ("the silver lid", "d")])
def test_a_lid_may_be_called_by_the_colour_of_its_jar(words, meant):
    found = ground(read_phrase(words.split()), jars())
    assert isinstance(found, Grounded), found.message
    assert found.object.id == meant


def test_a_colour_that_neither_lid_nor_jar_has_means_none():
    found = ground(read_phrase(["the", "magenta", "lid"]), jars())
    assert not isinstance(found, Grounded)
    assert found.kind == "nothing_matches"


def test_a_lid_of_the_colour_comes_before_the_lid_of_such_a_jar():
    found = ground(read_phrase(["the", "orange", "lid"]), jars("orange", (1.0, 0.5, 0.0)))
    assert not isinstance(found, Grounded)
    assert found.kind == "ambiguous"


@pytest.mark.parametrize(
    ("colour", "fits"), [("blue", True), ("violet", True), ("red", False), ("lime", False)]
)
def test_a_colour_between_two_words_goes_by_either(colour, fits):
    can = thing("a", "violet cylinder", "cylinder", (0.2, 0.1), (0.0, 0.2, 0.8))
    found = ground(read_phrase(["the", colour, "cylinder"]), scene(can))
    assert isinstance(found, Grounded) is fits


def test_a_plain_colour_goes_by_its_own_word_alone():
    can = thing("a", "violet cylinder", "cylinder", (0.2, 0.1), (0.5, 0.0, 1.0))
    assert not isinstance(ground(read_phrase(["the", "blue", "cylinder"]), scene(can)), Grounded)


def test_a_marker_that_is_called_so_is_no_place():
    pen = thing("a", "large marker", "other", (0.2, 0.1), (0.1, 0.1, 0.1))
    cube = thing("b", "red cube", "box", (0.2, -0.2), (1.0, 0.0, 0.0))
    found = ground(read_phrase(["the", "marker"], ["big"]), scene(pen, cube), movable=True)
    assert isinstance(found, Grounded), found.message
    assert found.object.id == "a"
