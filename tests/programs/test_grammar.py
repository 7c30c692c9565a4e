"""The grammar of programs: well formed, and what it allows is what fits and can be read."""

import re
from dataclasses import replace

import pytest

from gvla2.planning.scene_brief import scene_brief
from gvla2.programs.examples import EXAMPLES
from gvla2.programs.faithful import named_things
from gvla2.programs.grammar import fitting, grammar
from gvla2.programs.interpreter import ProgramInterpreter
from gvla2.programs.waypoints import grammar as waypoint_grammar
from gvla2.skills.table import STANDARD
from gvla2.testing import inputs

REQUEST = inputs.plan_request()
BRIEF = scene_brief(REQUEST.scene)
CAN = fitting(REQUEST, STANDARD, BRIEF)


def rules(text):
    """Name and body by rule, after a look at every token of llama.cpp's form."""
    token = re.compile(r'"(?:[^"\\\n]|\\.)*"|\[[^\]\n]*\]|\{\d+,\d+\}|::=|[()|?*+]|[a-z][a-z-]*|\s+')
    found = {}
    for line in text.splitlines():
        at = 0
        while at < len(line):
            match = token.match(line, at)
            assert match, line[at:]
            at = match.end()
        name, _, body = line.partition(" ::= ")
        assert body.count("(") - body.count(")") == sum(
            s.count("(") - s.count(")") for s in re.findall(r'"(?:[^"\\]|\\.)*"', body)
        )
        found[name] = body
    for body in found.values():
        bare = re.sub(r'"(?:[^"\\]|\\.)*"|\[[^\]]*\]', "", body)
        assert set(re.findall(r"[a-z]+", bare)) <= set(found)
    return found


@pytest.mark.parametrize("wish", ["lift the red cube", "push it 5 cm to the left of the blue cube"])
def test_the_grammar_is_well_formed(wish):
    found = rules(grammar(STANDARD, CAN, wish, named_things(wish, REQUEST.scene, BRIEF.names)))
    assert "root" in found
    assert ("left_of" in found["call"]) == ("left" in wish)
    assert ("way" in found["call"]) == ("left" in wish)
    assert '"pick(red_cube"' in found["call"]


def test_the_grammar_of_waypoints_is_well_formed():
    assert set(rules(waypoint_grammar([], bare=True))) == {"root", "first", "point", "int"}
    found = rules(waypoint_grammar(["red_cube", "blue_cube"], bare=False, first=["red_cube"], most=5))
    assert set(found) == {"root", "first", "point", "int", "name", "begin"}
    assert "blue_cube" in found["name"]
    assert "blue_cube" not in found["begin"]
    assert "{1,4}" in found["root"]


def test_the_first_call_is_about_what_is_named():
    wish = "put the red cube on the blue cube"
    first = rules(grammar(STANDARD, CAN, wish, named_things(wish, REQUEST.scene, BRIEF.names)))["first"]
    assert "red_cube" in first
    assert '"pick(' not in first  # no pick is about both


def test_nothing_fits_in_an_empty_scene():
    empty = replace(REQUEST, scene=replace(REQUEST.scene, objects=()))
    assert fitting(empty, STANDARD, scene_brief(empty.scene)) == {}


@pytest.mark.parametrize(("skill", "example"), [(s, e) for s, each in EXAMPLES.items() for e in each])
def test_examples_can_be_read(skill, example):
    names = {line.partition(" ")[0] for line in example.things.splitlines()}
    (call,) = ProgramInterpreter(REQUEST.scene, {n: n for n in names}, STANDARD).run(example.call)
    assert call.skill == skill
