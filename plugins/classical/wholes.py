"""Which wholes are looked for, and in which order."""

from __future__ import annotations

from gvla2_plugins.classical.cases import join_boxes, join_drawers, name_open_lids, name_towers
from gvla2_plugins.classical.composites import Rule
from gvla2_plugins.classical.upright import join_bottles, join_stems, name_knives

WHOLES: tuple[Rule, ...] = (
    Rule("a box and its open lid", name_open_lids),
    Rule("a box and its lid", join_boxes),
    Rule("a cabinet, its drawer and the handle", join_drawers),
    Rule("a tower and what sticks out of it", name_towers),
    Rule("a stand and what is in it", join_stems),
    Rule("a knife and its block", name_knives),
    Rule("a bottle or jar and what closes it", join_bottles),
)
"""Cases before what stands upright: a side of a box is not to be taken for a bottle."""
