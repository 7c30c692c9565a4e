from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.planning.colours import FAMILIES
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.clauses import LONGEST
from gvla2_plugins.skill.grammar import DIRECTED, MARKERS, parse
from gvla2_plugins.skill.words import noun_class, take_length, tokenise, verbs_of

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
robot, go ahead and pick up the red one
don't push it, pick up the red cube
seize the red object
I want the red cube off the table
get the red cube off the table
the red cube should come off the table
I would like the red cube in the air
I need the red block up in the air
move the red cube off the table
carry the red cube up into the air
remove the red cube from the table
lift up only the red cube, leave the others
lift only the red cube and leave the rest where they are
pick up the red cube, leave the blue one alone
pick up the red cube but let the others be
lift the red cube while keeping the others where they are
lift the red cube leaving the others on the table
lift the red cube; the others stay where they are
ignore the other cubes and lift the red one
disregard the blue block, lift the red block
red cube: lift it
red cube: lift
the red cube, pick it up please
lift: red cube
lift the cube: red
lift the cube, the red one
pick up the cube - the red one
pick up a cube, namely the red one
find the red cube and pick it up
locate the red cube, then lift it
reach for the red cube and raise it
go to the red cube, grab it and lift it
look for the red block and lift it
of all the cubes, lift the red one
among the cubes, pick the red one up
out of the three cubes, take the red one
from the three cubes lift the red one
there is a red cube on the table; pick it up
see the red cube? lift it
do you see the red cube? pick it up
what I need is the red cube lifted up
your task is to lift the red cube
your job: lift the red cube
if you can, lift the red cube
have the red cube lifted
not the blue one, lift the red one
the one to lift is the red cube
the cube to pick up is the red one
would you mind lifting the red cube?
time to lift the red cube
make the red cube rise
take the red cube, and only that, off the table
as for the red cube, lift it
only the red cube is to be lifted, nothing else
start by lifting the red cube
I want the red cube to be off the table
the red cube must not stay on the table, lift it
keep hold of the red cube and raise it
you should grip the red cube and then hoist it""".splitlines()
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
close your gripper and push the red block onto the blue target
I'd like you to scoot the red cube to the blue pad
drive the red block into the blue area
shove the red block into the blue marked area
ram the red block into the blue painted zone
herd the red cube toward the blue zone
I want the red block pushed onto the blue square
red block: push it onto the blue square
the red block: slide it to the blue square
find the red block and push it to the blue target
onto the blue square, push the red block
to the blue square push the red block
get the red block onto the blue square by pushing
use a push to get the red block onto the blue square
keep pushing the red block until it is on the blue square
push the red block so that it covers the blue target
make the red block slide onto the blue square
get the red block to slide onto the blue square
the red block has to end up on the blue square; push it
push the red block, not the others, onto the blue square
start pushing the red block toward the blue square
there's a red block: slide it to the blue spot
push the red block along the table to the blue mark
without grasping, move the red block to the blue target by shoving it
go to the red block and push it onto the blue square
by pushing, bring the red block onto the blue square
the red block should slide over to the blue square
would you mind pushing the red block onto the blue square?
push the red block to the square, the blue one
push the block onto the blue square: the red block
coax the red block across to the blue pad
with the gripper closed, push the red block to the blue square
coax the red cube over to the blue spot
plough the red cube to the blue patch
steer the red cube into the blue designated region""".splitlines()
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
press down on the switch
use the button to turn on the light
using the button, switch the lamp on
turn the lamp on with its button
turn on the lamp via the button
the lamp: turn it on
button: press
the button, press it
I want the lamp on
I'd like the light on
I want the light switched on
I need the lamp to shine
get the lamp to shine
get the light going
lamp on please
find the button and press it
locate the switch and push it
reach for the button and press it
give the button a press
give the button a push
there's a button on the lamp; press it
it's dark, turn on the lamp
it is too dark in here, switch on the light
press the button so that the lamp lights up
press the button until the lamp is on
with one finger, press the button
the button needs pressing
operate the lamp's switch
the lamp should light up
make sure the lamp is on
make the lamp light up
push on the button
push the lamp's button down
get the lamp to come on
would you mind switching on the lamp?
have the lamp turned on
let the lamp shine
the lamp is off; turn it on
the lamp must be switched on by its button
press down the button on top of the lamp base
let there be light
the lamp needs to be on
engage the switch
make it light up by pressing the button
to turn the lamp on, press the button
in order to switch on the lamp push the button""".splitlines()


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
    ["sing a song", "frobnicate the block", "kick the cube", "pack the cube", "the red cube", "",
     "don't touch anything", "hello there", "¿?", "12 cm", "leave the red cube alone",
     "ignore the red cube", "find the red cube", "go to the red cube", "the red cube stays on the table",
     "I do not want the red cube lifted", "the red cube should not be lifted", "turn off the lamp",
     "I want the lamp off", "put the lamp off", "knock the cube over", "the lamp: blue"],
)  # fmt: skip
def test_what_is_no_skill_of_ours_is_none(sentence):
    assert parse(sentence).skill in ("", "unsupported")


@pytest.mark.parametrize("sentence", ["wipe the cube", "lift the red cube and wash it"])
def test_a_verb_that_is_understood_and_not_carried_out_is_told(sentence):
    assert "is no skill of this planner" in parse(sentence).trouble


@pytest.mark.parametrize(
    "sentence",
    ["pick up the red cube and the blue cube", "push the cube and press the button", "pick up it and the red cube",
     "pick up the cube and put the ball on the tray", "pick up the cube and the blue one", "pick up the cube, the ball",
     "red cube. blue cube. lift.", "use the block to push the red cube onto the square",
     "use the red cube to press the button", "lift the red cube, the blue cube"],
)  # fmt: skip
def test_two_wishes_at_once_are_said_to_be_two(sentence):
    assert "one at a time" in parse(sentence).trouble


def test_clauses_without_a_verb_say_more_of_what_was_named():
    intent = parse("push the block to the square: the blue one")
    assert (intent.theme.colour, intent.goal.noun, intent.goal.colour) == ("", "target", "blue")
    intent = parse("there is a white tray; put the red cube on it")
    assert (intent.skill, intent.theme.colour, intent.goal.noun, intent.goal.colour) == (
        "place",
        "red",
        "tray",
        "white",
    )
    assert parse("there is a cube on the tray; lift it").theme.landmark[1].noun == "tray"
    assert parse("lift the cubes - the left one").theme.selectors == ("left",)
    assert parse("lift the red cube so that it stays in the air").skill == "pick"
    assert parse("push the cube off the table").skill == "push"  # which has no goal: nothing is thrown down
    assert parse("drop the cube off the table").skill == "place"


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=60))
def test_any_text_can_be_parsed(text):
    assert parse(text).skill in ("", "unsupported", "fetch", *lexicon.VERBS)


_TABLES = (*lexicon.RELATIONS.values(), *lexicon.SELECTORS.values(), *lexicon.VERBS.values())
_KNOWN = sorted(
    {word for table in _TABLES for phrase in table for word in phrase.split()}
    | set(FAMILIES)
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
    assert take_length(["up", "twenty", "five", "cm"]) == (["up"], pytest.approx(0.25))
    assert take_length(["push", "by", "15", "cm", "now"]) == (["push", "now"], pytest.approx(0.15))
    assert take_length(tokenise("up by .5 m")) == (["up"], pytest.approx(0.5))
    assert take_length(["half", "a", "metre", "up"]) == (["up"], pytest.approx(0.5))
    assert take_length(["put", "a", "in", "b"]) == (["put", "a", "in", "b"], None)


def test_no_wording_is_longer_than_what_is_looked_up():
    wordings = (*MARKERS, *DIRECTED, *lexicon.NEGATIONS)
    assert max(len(wording.split()) for wording in wordings) <= LONGEST
