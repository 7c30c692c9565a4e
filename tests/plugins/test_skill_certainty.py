"""What cannot be read with certainty is declined, and what a sentence rules out is heeded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2_plugins.skill.planner import read


def thing(name, label, shape, xy, opening=0.0, parent=""):
    pose = rigid(translation=(*xy, 0.8))
    colour = label.split()[0]
    return SceneObject(
        name, label, shape, colour, pose, np.full(3, 0.06), np.zeros((0, 3)), opening=opening, parent=parent
    )


def scene(*things):
    return Scene(things, 0.75, Box(np.array([-0.3, -0.7, 0.75]), np.array([0.8, 0.7, 1.7])))


CUBES = scene(
    *(thing(c[0], f"{c} cube", "box", (0.3, 0.15 * i)) for i, c in enumerate(("blue", "maroon", "lime")))
)
TRAY = scene(
    thing("t", "gray tray", "box", (0.1, 0.0), 0.15),
    thing("g", "green box", "box", (0.2, 0.2)),
    thing("y", "yellow bottle", "cylinder", (0.3, -0.2)),
    thing("k", "orange knife block", "box", (0.4, 0.3)),
)
LAMP = scene(
    thing("s", "gray lamp shade", "disc", (0.3, 0.0), parent="l"),
    thing("l", "black lamp base", "plate", (0.3, 0.1)),
    thing("b", "rose button", "disc", (0.3, 0.2), parent="l"),
)
DRAWER = scene(
    thing("c", "gray cabinet", "box", (0.4, 0.0), 0.3),
    thing("d", "lime drawer", "box", (0.3, 0.0), 0.1, parent="c"),
)


@pytest.mark.parametrize(
    ("sentence", "themes"),
    [
        ("pick up the cube that is not blue and not lime", {"m"}),
        ("lift the cube that is neither blue nor maroon", {"l"}),
        ("lift any cube except the blue one", {"m", "l"}),
        ("pick up any cube but the maroon one", {"b", "l"}),
        ("pick up any cube other than the lime one", {"b", "m"}),
        ("lift the blue cube without touching the maroon one", {"b"}),
        ("don't push the blue cube, lift the maroon one", {"m"}),
        ("lift the lime cube, not the others", {"l"}),
        ("don't touch the blue one and not the maroon one, lift the cube that is left over", {"l"}),
        ("pick up any cube, but do not touch the lime one", {"b", "m"}),
    ],
)
def test_exceptions_are_heeded(sentence, themes):
    found = read(sentence, CUBES)
    assert not isinstance(found, Abstention), found
    assert found.calls[0].theme in themes


@pytest.mark.parametrize(
    ("sentence", "where"),
    [
        ("pick up a cube, not the blue one", CUBES),
        ("pick up a cube that is not blue or maroon", CUBES),
        ("pick up the cube which isn't the one I like", CUBES),
        ("pick up all cubes but the blue one", CUBES),
        ("lift the second cube", CUBES),
        ("lift the cube on my left", CUBES),
        ("don't touch the green box, put the other box in the tray", replace(TRAY, objects=TRAY.objects[:2])),
        ("lift the cube closest to the maroon cube", CUBES),
        ("pick up the blue cube or the maroon cube", CUBES),
        ("if there is a red cube lift it, otherwise lift the blue one", CUBES),
        ("lift the blue cube unless it is heavy", CUBES),
        ("lift the blue cube twice", CUBES),
        ("put the blue cube between the maroon and the lime cube", CUBES),
        ("lift the blue cube but don't lift it", CUBES),
        ("pick up the red cube", CUBES),
        ("put the milk carton in the tray", TRAY),
        ("put the ketchup in the tray", TRAY),
        ("put the can in the tray", TRAY),
        ("lift the donut", scene(thing("y", "yellow bottle", "cylinder", (0.3, -0.2)))),
        ("lift the towel", scene(thing("w", "white tower", "box", (0.3, -0.2)))),
        ("put the bottle in the basket", TRAY),
        ("put everything except the green box in the tray", TRAY),
        ("put the bottle in the tray upside down", TRAY),
        ("put the bottle under the tray", TRAY),
        ("press the lamp shade", LAMP),
        ("turn on the radio", LAMP),
        ("turn on the lamp without pressing the button", LAMP),
        ("don't turn on the lamp", LAMP),
        ("turn the lamp off", LAMP),
    ],
)
def test_what_is_not_certain_is_declined(sentence, where):
    found = read(sentence, where)
    assert isinstance(found, Abstention), found
    assert found.message


def test_a_kind_is_believed_of_the_only_thing_of_its_noun():
    assert read("put the mustard bottle in the tray", TRAY).calls[0].theme == "y"
    two = scene(*TRAY.objects, thing("z", "white bottle", "cylinder", (0.5, 0.0)))
    assert read("put the mustard bottle in the tray", two).calls[0].theme == "y"  # mustard is yellow
    assert isinstance(read("put the shampoo bottle in the tray", two), Abstention)
    assert read("put the knife block on the green box", TRAY).calls[0].theme == "k"


@pytest.mark.parametrize(
    "sentence",
    [
        "lift the blue cube, but don't let it leave the table",
        "lift the blue cube, but do not let go of the table",
        "put the blue cube on the maroon cube but keep it on the table",
        "lift the blue cube but don't move it",
        "lift the blue cube, not too high",
    ],
)
def test_a_prohibition_that_is_not_understood_declines(sentence):
    assert isinstance(read(sentence, CUBES), Abstention)


@pytest.mark.parametrize(
    ("sentence", "theme"),
    [
        ("lift the green cube", "l"),
        ("lift the dark red cube", "m"),
        ("I'm cleaning up, so lift the lime cube", "l"),
        ("lift the blue cube so I can wipe the desk", "b"),
    ],
)
def test_people_name_shades_by_their_family_and_tell_what_they_are_at(sentence, theme):
    assert read(sentence, CUBES).calls[0].theme == theme


@pytest.mark.parametrize(
    ("sentence", "theme"),
    [("sort the mustard into the tray", "y"), ("place the yellow mustard in the tray", "y")],
)
def test_what_comes_in_bottles_of_a_colour_names_the_one_bottle(sentence, theme):
    assert read(sentence, TRAY).calls[0].theme == theme
    two = replace(TRAY, objects=(*TRAY.objects, thing("z", "yellow bottle", "cylinder", (0.5, 0.3))))
    assert read(sentence, two).kind == "ambiguous"


def test_one_of_several_is_the_one_that_is_said():
    pegs = [thing(c[0], f"{c} post", "box", (0.3, 0.15 * i)) for i, c in enumerate(("red", "blue", "black"))]
    found = read("lift the middle one of the three pegs", scene(*pegs[1:], pegs[0]))
    assert found.calls[0].theme == "b"


def test_what_is_absent_is_said_to_be_even_where_several_things_are_asked():
    assert read("lift the pineapple and then shut it", CUBES).kind == "nothing_matches"


def test_cups_go_into_cups():
    cups = scene(
        thing("w", "white cup", "cylinder", (0.1, 0.0), 0.05),
        thing("p", "pink cup", "cylinder", (0.3, 0.0), 0.05),
    )
    assert read("put the white cup inside the pink one", cups).calls[0].goal == "p"


def test_the_body_of_a_thing_is_the_thing():
    bottle = scene(
        thing("b", "green bottle", "cylinder", (0.3, 0.0)),
        thing("c", "yellow cap", "box", (0.3, 0.0), parent="b"),
    )
    assert read("lift the bottle's green body", bottle).calls[0].theme == "b"
    assert isinstance(read("lift the bottle's red body", bottle), Abstention)


@pytest.mark.parametrize(
    ("sentence", "calls"),
    [
        ("put the green carton in the tray", [("g", "t")]),
        ("Put the green parcel in the bin, and then the yellow one", None),
        ("put the green box in the tray, then put the flask in the tray", [("g", "t"), ("y", "t")]),
        ("put the green box in the tray, then put the ladle in the tray", None),
        ("put the thing with the green handle in the tray", [("g", "t")]),
        ("lift the box that is standing next to the tray", [("g", "")]),
        ("lift the other bottle", None),
    ],
)
def test_things_by_what_they_look_like_and_one_wish_after_another(sentence, calls):
    found = read(sentence, TRAY)
    assert (None if isinstance(found, Abstention) else [(c.theme, c.goal) for c in found.calls]) == calls


@pytest.mark.parametrize(
    ("sentence", "unread"),
    [
        ("put the green dingus in the tray", True),  # what a dingus is it does not know
        ("lift the dingus", False),  # nothing tells what it may be
        ("put the pink box in the tray", False),
        ("lift the umbrella", False),
        ("put the green box in the jar", False),
    ],
)
def test_what_is_not_understood_is_told_from_what_is_not_there(sentence, unread):
    found = read(sentence, TRAY)
    assert (found.kind, found.unread) == ("nothing_matches", unread)


@pytest.mark.parametrize(
    "sentence",
    [
        *(f"{verb} lifting the blue cube" for verb in ("refrain from", "abort", "skip", "forget about", "prohibit")),
        *(f"{verb} to lift the blue cube" for verb in ("refuse", "decline", "pretend", "neglect")),
        "cancel: lift the blue cube",
        "prevent the blue cube from being lifted",
        "push the blue cube 10 cm to the left and 5 cm forward",
        "lift the blue cube 10 cm and move it 20 cm to the left",
        "put the blue cube to the left of the lime cube and to the right of the maroon one",
        "put the blue cube behind the lime cube and on the maroon cube",
        "put the blue cube on the lime cube and push it 5 cm to the left",
        "push the lime cube with the blue cube",
        "lift the blue cube at 0.2 m/s",
        "lift the blue cube 10 cm/s",
        "lift the blue cube by 20 %",
        "lift the blue cube 10",
        'lift the blue cube 5"',
        "lift the blue cube one and a half inches",
        "lift the blue cube that is on the lime cube",
        "lift the blue cube after lifting the lime cube",
        "lift the blue cube higher than the lime cube",
        "take a photo of the blue cube",
        "take care of the blue cube",
        "push the blue cube towards the lime cube but do not touch it",
        "push the blue cube to the left without moving it",
        "lift the blue cube without touching it",
    ],
)  # fmt: skip
def test_what_would_be_done_otherwise_than_it_is_said_is_declined(sentence: str):
    assert isinstance(read(sentence, CUBES), Abstention)


def test_a_drawer_is_not_opened_without_pulling():
    assert isinstance(read("open the drawer without pulling", DRAWER), Abstention)
    assert not isinstance(read("open the drawer", DRAWER), Abstention)


def test_only_what_is_ruled_out_by_name_is_noted():
    found = read("lift the blue cube without touching the lime cube", CUBES)
    assert found.notes == ("The sentence rules out lime cube.",)
    assert read("lift the blue cube without dropping it", CUBES).notes == ()
