from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.grammar import parse
from gvla2_plugins.skill.words import likeness, noun_class, spell, take_length, tokenise, verbs_of

PICK = """pick up the red cube
pick the red cube up
please lift the red block
could you grab the red cube for me?
raise the red block off the table
take the red cube
hoist the red box into the air
get hold of the red cube
fetch the red block
Collect the red cube, please.
I want you to lift up the red block
the red cube should be lifted
grasp the cube that is red and lift it up to the target height
take the red block and hold it up high
close your fingers around the red cube and raise it
elevate the red-coloured brick
pcik up the red blok
robot, go ahead and pick up the red one
don't push it, pick up the red cube
seize the red object""".splitlines()
PUSH = """push the red block onto the blue square
slide the red cube to the blue target
shove the red block over to the blue patch on the table
move the red cube onto the blue square by pushing it
without lifting it, push the red block until it is on the blue target
nudge the red cube toward the blue area
use the gripper to push the red block onto the blue square
the red cube needs to be pushed onto the blue square
please could you slide the red box so that it sits on the blue region
sweep the red block into the blue zone
give the red block a push towards the blue target
push the red cube, without picking it up, to the blue mark
shift the red block across to the blue goal
phush the red block onto the blue sqare
close your gripper and push the red block onto the blue target
I'd like you to scoot the red cube to the blue pad""".splitlines()
PRESS = """turn on the lamp
turn the lamp on
press the button
press the lamp's button
push the button of the lamp
switch on the light
switch the light on by pressing the button
press the button to switch the lamp on
light up the lamp
activate the lamp
make the lamp shine
hit the switch
push down the button
the lamp should be on
could you put the light on, please
lights on
tap the button on the lamp
illuminate the lamp
press down on the switch""".splitlines()


@pytest.mark.parametrize("sentence", PICK)
def test_wordings_of_picking(sentence):
    intent = parse(sentence)
    assert (intent.skill, intent.theme.colour, intent.goal, intent.trouble) == ("pick", "red", None, "")


@pytest.mark.parametrize("sentence", PUSH)
def test_wordings_of_pushing(sentence):
    intent = parse(sentence)
    assert (intent.skill, intent.theme.colour, intent.trouble) == ("push", "red", "")
    assert (intent.goal.colour, intent.goal.noun) == ("blue", "target")


@pytest.mark.parametrize("sentence", PRESS)
def test_wordings_of_pressing(sentence):
    intent = parse(sentence)
    assert (intent.skill, intent.trouble) == ("press", "")
    assert intent.theme is None or intent.theme.noun in ("button", "lamp")


@pytest.mark.parametrize(
    "sentence",
    ["put the red cup on the tray", "grab the red cup and put it on the tray", "place the red mug onto the tray",
     "bring the red cup to the tray", "pick up the red cup, then set it down on the tray",
     "I want the red cup on the tray", "move the red cup from the table to the tray"],
)  # fmt: skip
def test_wordings_of_placing(sentence):
    intent = parse(sentence)
    assert (intent.skill, intent.theme.noun, intent.theme.colour, intent.goal.noun) == (
        "place",
        "cup",
        "red",
        "tray",
    )


@pytest.mark.parametrize(
    ("sentence", "amount", "direction"),
    [
        ("lift the cube 10 cm", 0.10, None),
        ("raise the cube by fifteen centimetres", 0.15, None),
        ("push the block forward 7.5cm", 0.075, (1.0, 0.0)),
        ("push the block to the left", None, (0.0, 1.0)),
        ("slide the left block right by 50 mm", 0.05, (0.0, -1.0)),
        ("push the block back toward you by half a metre", 0.5, (-1.0, 0.0)),
        ("put the cube 10 cm to the right", 0.10, (0.0, -1.0)),
        ("pick up one of the cubes", None, None),
    ],
)
def test_lengths_and_directions(sentence, amount, direction):
    intent = parse(sentence)
    assert intent.amount == (pytest.approx(amount) if amount else None)
    assert intent.direction == direction


def test_phrases_keep_what_singles_one_out():
    theme = parse("pick up the biggest dark blue cube next to the bowl").theme
    assert (theme.noun, theme.colour, theme.selectors) == ("block", "navy", ("big",))
    assert (theme.landmark[0], theme.landmark[1].noun) == ("beside", "bowl")
    goal = parse("push the block to the left of the red cube")
    assert (goal.relation, goal.goal.colour, goal.direction) == ("left_of", "red", None)
    assert parse("push the block on the left to the right").theme.selectors == ("left",)


@pytest.mark.parametrize(
    "sentence",
    ["open the drawer", "sing a song", "frobnicate the block", "kick the cube", "pack the cube", "the red cube", "",
     "don't touch anything", "unscrew the lid", "hello there", "¿?", "12 cm"],
)  # fmt: skip
def test_what_is_no_skill_of_ours_is_none(sentence):
    assert parse(sentence).skill in ("", "unsupported")


@pytest.mark.parametrize("sentence", ["pick up the red cube and the blue cube", "push the cube and press the button",
                                      "pick up the cube and put the ball on the tray"])  # fmt: skip
def test_two_wishes_at_once_are_said_to_be_two(sentence):
    assert "one at a time" in parse(sentence).trouble


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=60))
def test_any_text_can_be_parsed(text):
    assert parse(text).skill in ("", "unsupported", "pick", "place", "push", "press")


_TABLES = (*lexicon.RELATIONS.values(), *lexicon.SELECTORS.values(), *lexicon.VERBS.values())
_KNOWN = sorted(
    {word for table in _TABLES for phrase in table for word in phrase.split()}
    | set(lexicon.COLOUR_WORDS)
    | {"'s", "of", "it", "and", "block", "lamp", "without"}
)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.sampled_from(_KNOWN), max_size=9))
def test_any_order_of_known_words_can_be_parsed(words):
    assert isinstance(parse(" ".join(words)).trouble, str)


def test_words():
    assert tokenise("Lamp's button, 15cm!") == ["lamp", "'s", "button", ",", "15", "cm", "!"]
    assert verbs_of("grabbing") == {"grab"}
    assert verbs_of("pushes") == {"push"}
    assert verbs_of("left") == frozenset()
    assert noun_class("boxes") == "block"
    assert likeness("push", "push") == 1.0 > likeness("push", "phush") > likeness("push", "cube")
    assert spell(["blok", "kick"], 1.0) == (["blok", "kick"], [])
    assert spell(["stapler"], 0.7, frozenset({"stapler"})) == (["stapler"], [])
    assert take_length(["up", "twenty", "five", "cm"]) == (["up"], pytest.approx(0.25))
