"""Asides, telling descriptions and wishes in other forms: what is read in spite of them, and what must be declined."""

from __future__ import annotations

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2_plugins.skill.grammar import heard
from gvla2_plugins.skill.planner import read


def thing(name, label, shape, xy, opening=0.0, parent="", z=0.8):
    pose = rigid(translation=(*xy, z))
    colour = label.split()[0]
    return SceneObject(
        name, label, shape, colour, pose, np.full(3, 0.06), np.zeros((0, 3)), opening=opening, parent=parent
    )


def scene(*things):
    return Scene(things, 0.75, Box(np.array([-0.3, -0.7, 0.75]), np.array([0.8, 0.7, 1.7])))


SCENES = {
    "square": scene(
        thing("c", "red cube", "box", (0.1, 0.2)), thing("s", "azure square", "region", (0.3, 0.0))
    ),
    "wine": scene(
        thing("b", "green bottle", "cylinder", (0.3, 0.0)),
        thing("c", "yellow cap", "cylinder", (0.3, 0.0), parent="b", z=0.9),
    ),
    "tray": scene(
        thing("g", "green box", "box", (0.0, -0.1)),
        thing("y", "yellow bottle", "box", (0.05, 0.28)),
        thing("t", "gray tray", "box", (0.4, -0.3), 0.15),
        thing("a", "azure cylinder", "cylinder", (0.5, 0.4)),
    ),
    "lamp": scene(
        thing("s", "gray lamp shade", "disc", (0.3, 0.0), parent="l"),
        thing("l", "black lamp base", "plate", (0.3, 0.1)),
        thing("m", "magenta button", "disc", (0.3, 0.2), parent="l"),
    ),
    "cups": scene(
        thing("w", "white cup", "cylinder", (0.1, 0.0), 0.05),
        thing("m", "magenta cup", "cylinder", (0.3, 0.0), 0.05),
    ),
    "posts": scene(
        thing("r", "red post", "box", (0.1, 0.0)),
        thing("o", "green ring", "ring", (0.3, 0.2)),
        thing("k", "black post", "box", (0.2, 0.0)),
    ),
    "knife": scene(
        thing("k", "green knife", "box", (0.1, 0.0)),
        thing("b", "orange knife block", "box", (0.3, 0.2)),
        thing("p", "white plate", "plate", (0.2, -0.2)),
    ),
}

READ = {
    "square": """c s|My lad's been messing about, so please put the red cube back on its blue square.
c s|You see that red cube? I want it on the blue square.
c s|Put the reddish cube on the blue square, I don't mind which way.
c s|I would appreciate having the red cube on the blue square.
c s|I'd love the red cube to sit on the blue square.
c s|The red cube belongs on the blue square, so please get it there.
c s|The red cube ought to be on the blue square, dear.
c s|Take the red cube and set it on the square, thank you kindly.""",
    "wine": """b |Open the wine for Nan.
b |Open that wine, quick, I got stuff on the stove.
b |I fancy a glass of wine, so open the bottle, would you?
b |Would you open the bottle, please? My wrists aren't what they were.
b |Open the bottle before the guests get here.""",
    "tray": """y t|Put the mustard on the tray, please, the yellow bottle with the little red top.
g t|Hey, toss that green box in the tray, I'm fixin' to carry everything out.
y t|See that yellow mustard? Put it in the tray.
y t|Mustard in the tray, please.
y t|The mustard goes in the tray, not in the green box.
y t|Can you see to it that the mustard ends up in the tray?""",
    "lamp": """m |Switch on that little black desk lamp, please, can't see a thing over here.
m |I'm reading, so flick the lamp on, would you?""",
    "cups": """w |Gimme that white cup.
m |I can't reach my pink cup, dear, lift it off the table.
m |Raise the pink cup, like you're making a toast.""",
    "posts": """o r|Just like the hoopla at the church fête, dear: would you drop the green ring over the red peg?
o r|Hoopla time! Green ring on the red peg, please.""",
    "knife": """k p|Knife out of the block, onto the white board.
k p|The knife ought to be on the chopping board, not in the block.""",
}

DECLINED = {
    # The clause beside the wish turns it, delays it, calls it off, or asks for more than can be done.
    "wine": """Don't open the wine.
Open the wine after Nan has left.
Open the wine unless Nan has had enough.
Open the wine once you have dried it.
Is the wine open?
Did you open the wine?
Who opened the wine?
Open the wine? Over my dead body.
I've opened the wine.
Nobody opens the wine.
I hope nobody opens the wine.
It's too early to open the wine.
It'd be daft to open the wine.
Thanks for opening the wine.
Stop opening the wine.
I'd rather you didn't open the wine.
I'd open the wine but I can't find the corkscrew.
Open the wine, just kidding.
Open the wine. No, wait.
Open the wine, no, don't.
Open the wine, decant it into the jug.
Open the wine, Nan, and pour me a glass.
Open the wine and the beer.
Open the beer for Nan.
Open the window, dear, I'm hot.
Open the bottle with the key.
Would you like the bottle?
Nan says to open the wine, but leave it.
Make sure nobody opens the wine.
Make sure the wine is never open.
I'd like the wine opened when I get back.
Where's the corkscrew? Pass me that.
My glasses are behind the bottle, bring them to me.
Open the parcel, it's behind the bottle.""",
    # What is described is absent, or another thing than what is there.
    "tray": """Put the milk carton in the tray.
Put the Heinz in the tray.
Put the Coke in the tray, please.
Put the purple bottle in the tray.
Put the ketchup in the tray, the red bottle with the white cap.
Ketchup in the tray, please.
Put the mustard in the sink, I'm doing the tray.
Put the jug in the tray, the yellow one.
Put the little dog in the tray.
Put the mustard in the drawer.
Put the spoon next to the mustard in the tray.
Put the mustard and the ketchup in the tray.
Put the mustard in the tray, and the ketchup.
Put the mustard in the tray, the ketchup too.
Put the mustard, ketchup and milk in the tray.
Put the mustard lid in the tray.
Toss the salad in the tray.
Put the mustard in the tray and wash the tray.
Pass the scissors here.
Fetch the mustard from the fridge.
See that red mustard? Put it in the tray.
The mustard was in the tray yesterday.
Should the mustard go in the tray?
Does the mustard go in the tray?
Someone ought to have put the mustard in the tray.
Put the mustard in the tray if you've washed it.""",
    # States that are told or ruled out, and not wished for.
    "square": """The red cube is on the blue square.
Is the red cube on the blue square?
Keep the red cube off the blue square.
Put the red cube anywhere but on the blue square.
The red cube should not be on the blue square.
Red cube, green square.
Red cube on the green square, please.
I put the red cube on the blue square.
You've put the red cube on the blue square, well done.
Remember when you put the red cube on the blue square?
Someone put the red cube on the blue square.
You should never put the red cube on the blue square.
He said to put the red cube on the blue square.
Can the red cube sit on the blue square?
The red cube goes on the yellow square.
Where does the red cube go?
Put it on the blue square when the bell rings, the red cube.
Put a red cap on the blue square.
Swap the red cube and the blue square.
See that green cube? Put it on the blue square.
My grandson loves the red cube on the blue square.
Make sure the red cube is not on the blue square.""",
    # Words of several meanings, other things' names, and what is done already.
    "lamp": """Turn the lamp off.
Lamp off, please.
Turn the lamp on and off.
Is the lamp on?
Who put the lamp on?
I've put the lamp on.
The lamp's on already.
The lamp is on, turn it off.
Turn the lamp on when it gets dark.
Turn the light on in the hall.
Turn on the telly.
Pop the kettle on.
Press the green button.
How do I turn the lamp on?""",
    "cups": """Pick up the cup.
Pick up neither cup.
Pick up the green cup.
The pink cup is lovely, isn't it?
My tea is in the white cup.
Grab the saucer under the white cup.
Would you like the white cup?
Fill the pink cup and hold it up.
Don't give me the pink cup.""",
    "posts": """Ring the bell, please.
Ring off the red post, please.
Is the ring on the red post?
The green ring doesn't go on the red post.
The ring goes on the red post when Mia says so.
Put the ring on the yellow post.""",
    "knife": """Knife in the drawer, please.
Put the fork on the chopping board.
Bread on the chopping board, please.
Don't put the knife on the board.
The knife was on the board.
Put the red knife on the board.""",
}


@pytest.mark.parametrize(("where", "line"), [(k, line) for k, v in READ.items() for line in v.splitlines()])
def test_a_wish_is_read_beside_what_asks_for_nothing(where, line):
    meant, sentence = line.split("|")
    found = read(sentence, SCENES[where])
    assert not isinstance(found, Abstention), found
    theme, _, goal = meant.partition(" ")
    (call,) = found.calls
    assert (call.theme, call.goal) == (theme, goal)


@pytest.mark.parametrize(
    ("where", "sentence"), [(k, line) for k, v in DECLINED.items() for line in v.splitlines()]
)
def test_what_only_looks_like_a_wish_is_declined(where, sentence):
    found = read(sentence, SCENES[where])
    assert isinstance(found, Abstention), found


def test_plainer_words_do_not_eat_others():
    assert heard("put the dish on the greenish mat")[1:3] == ["the", "dish"]
    assert "please" not in heard("let me know if you could lift the cube")
