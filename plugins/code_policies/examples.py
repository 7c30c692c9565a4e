"""Worked examples of the standard skills for prompts, with objects that no task has."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from gvla2.planning.skill import Example

_CHEST = "brown_chest 300x200x150 at 250,80\nlid_of_brown_chest 300x200x10 at 250,80 up 150"
_TUBE = "cap_of_tall_tube 30x30x15 at 210,-60 up 180\ntall_tube 40x40x180 at 210,-60"

EXAMPLES: Mapping[str, tuple[Example, ...]] = MappingProxyType(
    {
        "place": (
            Example(
                "red_pepper 60x50x70 at 100,50\nwhite_bowl 140x140x60 open 130 at 300,-100",
                "drop the pepper into the bowl",
                "place(red_pepper, white_bowl, in)",
            ),
            Example(
                "brown_mat 120x120 patch at 350,100\ngray_shelf 200x100x80 at 200,-60\n"
                "pink_book 150x30x90 at 210,-60 up 10",
                "pull the book off the shelf and lay it on the mat",
                "place(pink_book, brown_mat, on)",
            ),
        ),
        "push": (
            Example(
                "yellow_circle 100x100 patch at 350,-40\ngreen_puck 60x60x20 at 150,90",
                "shove the puck over to the yellow spot",
                "push(green_puck, yellow_circle)",
            ),
        ),
        "press": (
            Example(
                "switch_of_gray_fan 20x20x8 at 300,10 up 30\ngray_fan 100x100x200 at 300,40",
                "start the fan",
                "press(switch_of_gray_fan)",
            ),
        ),
        "close": (Example(_CHEST, "fold the chest's cover down again", "close(brown_chest)"),),
        "open": (Example(_CHEST, "raise the cover of the chest", "open(brown_chest)"),),
        "twist": (
            Example(
                f"{_TUBE}\ngray_mat 120x120 patch at 350,100",
                "unscrew the tube and leave its cap on the mat",
                "twist(cap_of_tall_tube, gray_mat)",
            ),
            Example(_TUBE, "remove the tube's top", "twist(cap_of_tall_tube)"),
        ),
        "insert": (
            Example(
                "tan_disc 60x60x10 open 20 at 100,50\nred_peg 15x15x90 at 300,-100\nblue_peg 15x15x90 at 300,-200",
                "thread the disc onto the red peg",
                "insert(tan_disc, red_peg)",
            ),
        ),
        "pull": (
            Example(
                "tall_cabinet 300x300x250 at 400,0\nhandle_of_tall_cabinet 100x10x10 at 250,0 up 120",
                "get the cabinet's tray out",
                "pull(handle_of_tall_cabinet)",
            ),
        ),
        "pick": (
            Example(
                "blue_pen 12x12x140 at 250,20\nblack_mug 80x80x95 open 70 at 250,20",
                "fetch the pen from the mug",
                "pick(blue_pen)",
            ),
        ),
    }
)
