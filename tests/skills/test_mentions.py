"""Mentions: what a wish speaks of."""

from dataclasses import replace

import pytest

from gvla2.skills.mentions import mentions
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
