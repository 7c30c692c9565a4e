"""Wordings of lids, caps, drawers, rings and of taking things out: what each asks for."""

from __future__ import annotations

import pytest

from gvla2_plugins.skill.grammar import parse

OTHERS = {
    "open": """prise the lid off
pry the box open
flip the lid up
fold back the lid of the box
tip the lid back
uncover the box
pop the cap off the bottle
the box should be open
open the jar and put its lid on the blue square
i'd like to have a look inside that box
let me see what's in the box
pop the cap
please open that jar for me and leave the lid on the blue square""",
    "close": """shut the box
fold the lid down
bring the lid down onto the box
lower the lid of the box
tip the lid over until the box is shut
cover the box with its lid
seal the box
turn the lid over so the box shuts
make sure the box is closed
swing the lid back over the box
it gets dusty in there, so cover the box up""",
    "twist": """screw the lid off the red jar
twist off the lid of the red jar
open the red jar by twisting its lid
turn the lid of the red jar until it comes off
undo the bottle's cap
loosen the lid of the red jar and take it off
spin the cap off
unscrew the red jar and leave its lid on the green square""",
    "pull": """extract the umbrella from its stand
draw the umbrella from the stand
slide the umbrella up and out of the stand
pull on the handle of the drawer
give the drawer a pull
make the drawer come out
extract the drawer""",
    "pick": """take the umbrella out
the umbrella should come out of the stand
take off the lid of the red jar
remove the umbrella from its stand
hand me the umbrella
whisk the cup up off the table
could I have the cup, please
we have to paint, so fish the umbrella out of the stand""",
    "place": """hang the ring on the red pillar
lower the ring over the red pillar
stick the ring on the red pillar
mount the ring on the red pillar
put away the mustard in the tray
pop the block onto the circle
pass the ring over the red pillar
draw the red block from the tower and lay it on the circle
get the red brick out of the stack and onto the blue circle
take out the red brick and drop it on the blue circle""",
    "push": """work the block across to the target
slide the ring down the red pillar
move the block to the target without lifting it
without picking it up, move the cube to the square
glide the block to the square""",
    "press": """get the lamp lit
bring the lamp to life
make the lamp work
flip the switch up""",
}


@pytest.mark.parametrize(("skill", "sentence"), [(k, s) for k, v in OTHERS.items() for s in v.splitlines()])
def test_wordings_of_the_other_skills(skill, sentence):
    intent = parse(sentence)
    assert (intent.skill, intent.trouble) == (skill, "")
    assert (intent.goal is not None) == (
        skill in ("place", "push") or (" on the " in sentence and skill in ("open", "twist"))
    )


def test_a_word_of_the_verb_may_name_a_part_or_where_from():
    theme = parse("screw the lid off the red jar").theme
    assert (theme.noun, theme.owner.colour) == ("lid", "red")
    assert parse("turn the lid of the red jar").theme.noun == "lid"
    assert parse("draw the umbrella from the stand").theme.landmark[1].noun == "stand"
