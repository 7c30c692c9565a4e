"""What each skill applies to in a scene; and nothing goes where it is already, nor where it does not fit."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gvla2.skills.grounding import goals, no_room, themes
from gvla2.skills.table import STANDARD
from tests.skills.scenes import (
    LAMP,
    PATCH,
    POST,
    RING,
    TRAY,
    box,
    cube,
    drawer,
    jar,
    make_object,
    request,
    stuck_brick,
)

OBJECTS = (cube("cube", (0.3, 0.0)), PATCH, TRAY, *LAMP, *jar())
REQUEST = request(*OBJECTS)


def fitting(skill, *objects):
    asked = request(*objects)
    return {o.id for o in themes(STANDARD[skill], asked.scene, asked.arm.hand)}


def test_only_what_a_skill_can_work_is_its_theme():
    assert fitting("pull", *drawer()) >= {"bar"}
    assert fitting("pull", *OBJECTS) == set()
    assert fitting("press", *OBJECTS) >= {"knob"}
    assert "cube" not in fitting("press", *OBJECTS)
    assert fitting("twist", *OBJECTS) >= {"cap"}
    assert fitting("close", *box(1.2)) != set()
    assert "cube" in fitting("pick", *OBJECTS)
    assert fitting("insert", POST, RING) == {"ring"}


def test_paint_is_never_handled():
    for skill in STANDARD.values():
        assert "patch" not in {o.id for o in themes(skill, REQUEST.scene, REQUEST.arm.hand)}


def test_goals_are_neither_the_object_nor_its_parts_nor_where_it_is():
    scene = REQUEST.scene
    assert {g.id for g in goals(STANDARD["place"], scene["cap"], scene)} >= {"cube", "patch", "tray"}
    assert not {g.id for g in goals(STANDARD["place"], scene["cap"], scene)} & {"cap", "jar"}
    assert goals(STANDARD["press"], scene["knob"], scene) == ()


def test_a_skill_of_ones_own_brings_its_own_rule():
    odd = replace(STANDARD["pick"], name="juggle", fits=lambda obj, scene, hand: obj.id == "tray")
    assert [o.id for o in themes(odd, REQUEST.scene, REQUEST.arm.hand)] == ["tray"]
    free = replace(odd, fits=None)
    assert len(themes(free, REQUEST.scene, REQUEST.arm.hand)) == len(OBJECTS) - 1


CUBE = cube("a", (0.3, 0.1))
SOLID = make_object("b", "box", (0.1, 0.1, 0.05), (0.1, 0.1, 0.1), label="maroon cube")
NARROW = make_object("n", "box", (0.1, 0.2, 0.03), (0.06, 0.06, 0.06), label="gray tray", opening=0.03)
STICK = make_object("s", "bar", (0.3, 0.1, 0.15), (0.02, 0.02, 0.26))
DEEP = make_object("c", "cylinder", (0.3, 0.1, 0.05), (0.12, 0.12, 0.1), label="white cup", opening=0.11)


@pytest.mark.parametrize(
    ("theme", "goal", "objects", "why"),
    [
        (CUBE, SOLID, (), "does not seem to be open"),
        (CUBE, NARROW, (), "too large"),
        (STICK, DEEP, (), "already"),
        (jar()[1], jar()[0], (), "already"),
        (stuck_brick()[1], stuck_brick()[0], stuck_brick(), "already"),
    ],
)
def test_what_cannot_go_in_is_refused(theme, goal, objects, why):
    refusal = no_room(theme, goal, "in", request(*(objects or (theme, goal))).scene)
    assert refusal is not None
    assert why in refusal.message


@pytest.mark.parametrize(
    ("goal", "relation"), [(SOLID, "on"), (NARROW, "on"), (TRAY, "in"), (DEEP, "beside")]
)
def test_what_has_room_is_not_refused(goal, relation):
    assert no_room(CUBE, goal, relation, request(CUBE, goal).scene) is None
