"""Programs of calls: what is read, what is refused, and that the grammar allows what fits and can be read."""

import re
import time

import pytest

from gvla2.planning.contracts import RefusedError
from gvla2.planning.scene_brief import scene_brief
from gvla2.skills.table import STANDARD
from gvla2.testing import inputs
from gvla2_plugins.code_policies.planner import fitting, grammar, read_calls, worked_examples

REQUEST = inputs.plan_request()
FITS = fitting(REQUEST, STANDARD, scene_brief(REQUEST.scene))
IDS = {"red": "red_cube", "blue": "blue_cube"}


def run(text):
    return [str(c) for c in read_calls(text, IDS, STANDARD)]


@pytest.mark.parametrize(
    ("program", "calls"),
    [
        ("pick(red)", ["pick(red_cube)"]),
        ("place(red, blue, in)", ["place(red_cube, blue_cube, in)"]),
        ("place(theme=red, goal=blue, relation='on')", ["place(red_cube, blue_cube, on)"]),
        ("push(red, left, 50)", ["push(red_cube, 0.05 m, towards (0.00, 1.00))"]),
        ("# both\npick(red)\npick('blue')", ["pick(red_cube)", "pick(blue_cube)"]),
    ],
)
def test_programs_make_calls(program, calls):
    assert run(program) == calls


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("pick(red)\n" * 13, "12 calls"), ("#" * 5000, "characters"), ("", "calls no skill"),
        ("pick(red, blue)", "no goal; it got 2"), ("place(red, blue, red)", "got 3"), ("pick()", "got 0"),
        ("pick(red, speed=3)", "does not take"), ("pick(*[red])", "cannot be an argument"),
        ("fly(red)", "no skill 'fly'"), ("open('/etc/passwd')", "not among the objects"),
    ],
)  # fmt: skip
def test_what_is_not_a_program_is_refused_soon(program, why):
    began = time.monotonic()
    with pytest.raises((ValueError, RecursionError), match=why):
        run(program)
    assert time.monotonic() - began < 2.0


def test_a_program_may_decline():
    for argument, kind in (
        ("absent", "nothing_matches"),
        ("unclear", "ambiguous"),
        ("", "other"),
        ("red", "other"),
    ):
        with pytest.raises(RefusedError) as declined:
            run(f"pick(red)\ndecline({argument})")
        assert declined.value.abstention.kind == kind


def rules(text):
    """Name and body by rule; every rule that a body names exists."""
    found = {}
    for line in text.splitlines():
        name, _, body = line.partition(" ::= ")
        bare = re.sub(r'"(?:[^"\\]|\\.)*"|\[[^\]]*\]', "", body)
        assert bare.count("(") == bare.count(")")
        found[name] = body
    for body in found.values():
        bare = re.sub(r'"(?:[^"\\]|\\.)*"|\[[^\]]*\]', "", body)
        assert set(re.findall(r"[a-z]+", bare)) <= set(found)
    return found


def test_the_grammar_of_calls_is_well_formed_and_has_what_fits():
    found = rules(grammar(STANDARD, FITS, "push the cube 5 cm to the left"))
    assert '"pick(red_cube"' in found["call"]
    assert '"pull(' not in found["call"]
    assert "amount" in found["call"]
    assert "amount" not in rules(grammar(STANDARD, FITS, "push the cube to the left"))["call"]


@pytest.mark.parametrize(
    ("skill", "example"), [(s, e) for s, each in worked_examples().items() for e in each]
)
def test_examples_can_be_read(skill, example):
    names = {line.partition(" ")[0] for line in example[0].splitlines()}
    (call,) = read_calls(example[2], {n: n for n in names}, STANDARD)
    assert call.skill == skill
