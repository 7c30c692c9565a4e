"""Affordances: what each skill fits in a scene."""

from dataclasses import replace

from gvla2.skills.grounding import goals, themes
from gvla2.skills.table import STANDARD
from tests.skills import scenes

OBJECTS = (scenes.cube("cube", (0.3, 0.0)), scenes.PATCH, scenes.TRAY, *scenes.LAMP, *scenes.jar())
REQUEST = scenes.request(*OBJECTS)


def fitting(skill, *objects):
    request = scenes.request(*objects)
    return {o.id for o in themes(STANDARD[skill], request.scene, request.arm.hand)}


def test_only_what_a_skill_can_work_is_its_theme():
    assert fitting("pull", *scenes.drawer()) >= {"bar"}
    assert fitting("pull", *OBJECTS) == set()
    assert fitting("press", *OBJECTS) >= {"knob"}
    assert "cube" not in fitting("press", *OBJECTS)
    assert fitting("twist", *OBJECTS) >= {"cap"}
    assert fitting("close", *scenes.box(1.2)) != set()
    assert "cube" in fitting("pick", *OBJECTS)
    assert fitting("insert", scenes.POST, scenes.RING) == {"ring"}


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
