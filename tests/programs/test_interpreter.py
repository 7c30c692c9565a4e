"""The interpreter of programs: what it reads, what it refuses, and that it always ends soon."""

import time

import pytest

from gvla2.planning.calls import SkillCall, written
from gvla2.programs.interpreter import Declined, ProgramInterpreter, lines_of
from gvla2.skills.table import STANDARD
from gvla2.testing import inputs

SCENE = inputs.scene()
IDS = {"red": "red_cube", "blue": "blue_cube"}


def run(text):
    return [str(c) for c in ProgramInterpreter(SCENE, IDS, STANDARD).run(text)]


@pytest.mark.parametrize(
    ("program", "calls"),
    [
        ("pick(red)", ["pick(red_cube)"]),
        ("place(red, blue, in)", ["place(red_cube, blue_cube, in)"]),
        ("place(theme=red, goal=blue, relation='on')", ["place(red_cube, blue_cube, on)"]),
        ("push(red, left, 50)", ["push(red_cube, 0.05 m, towards (0.00, 1.00))"]),
        ("for t in things:\n    if height(t) < 50:\n        pick(t)", ["pick(blue_cube)"]),
        (
            "for t in things:\n    if colour(t) == 'red' and not y(t) > 0:\n        pick(t)",
            ["pick(red_cube)"],
        ),
        ("a = red\nif is_on(red, blue):\n    pass\nelif a in things:\n    pick(a)", ["pick(red_cube)"]),
    ],
)
def test_programs_make_calls(program, calls):
    assert run(program) == calls
    assert run("\n".join(lines_of(program))) == calls


def test_a_call_is_written_as_it_is_read():
    names = {i: n for n, i in IDS.items()}
    for line in ("pick(red)", "place(red, blue, in)", "push(red, left, 50)", "push(blue, red)"):
        (call,) = ProgramInterpreter(SCENE, IDS, STANDARD).run(line)
        assert written(call, names) == line
    assert written(SkillCall("place", "red_cube", xy=(0.3, 0.1)), names) == ""


def nested(depth):
    lines = [f"{'    ' * k}for a{k} in things:" for k in range(depth)]
    return "\n".join([*lines, "    " * depth + "pass"])


doubling = "a = [0, 0]\nb = [0, 0]\n" + "a = [a, a]\nb = [b, b]\n" * 60 + "if a == b:\n    pick(red)"


@pytest.mark.parametrize(
    ("program", "why"),
    [
        (nested(15), "steps"), (nested(60), "."), (doubling, "no lists"), ("pick(red)\n" * 13, "12 calls"),
        ("for t in things:\n t = red\n" * 140, "steps"), ("#" * 5000, "characters"), ("pass", "calls no skill"),
        ("not " * 900 + "red", "."), ("(" * 300 + "red" + ")" * 300, "."), ("x = " + "-" * 3000 + "1", "."),
        ("red = blue\npick(red)", "a name already"), ("for red in things:\n    pick(red)", "a name already"),
        ("things = [red]", "a name already"), ("if ghost:\n    pick(red)", "neither true nor false"),
        ("if not ghost:\n    pick(red)", "neither true nor false"), ("pick(red, blue)", "no goal"),
        ("place(red, blue, red)", "got 3"), ("push(red, up)", "not among the objects"), ("height(red, blue)", "."),
        ("x = height(red, blue)", "about 1 thing"), ("x = is_on(red)", "about 2 things"),
        ("x = height([red])", "nothing"),
        ("pick(red, amount=True)", "does not take"), ("push(red, left, 1e300)", "larger"),
        ("pick(*things)", "cannot be used"),
        ("pick(**things)", "does not take"), ("x = 1 + 1", "cannot be used"), ("x = red.label", "cannot be used"),
        ("x = f'{red}'", "cannot be used"), ("def f():\n    pick(red)", "cannot be used"), ("x = 'a' < 3", "compared"),
    ],
)  # fmt: skip
def test_what_is_no_program_is_refused_soon(program, why):
    began = time.monotonic()
    with pytest.raises(ValueError, match=why):
        run(program)
    assert time.monotonic() - began < 2.0


def test_it_declines():
    for said, reason in (("absent", "absent"), ("[1]", "impossible"), ("", "impossible")):
        with pytest.raises(Declined) as declined:
            run(f"pick(red)\ndecline({said})")
        assert declined.value.reason == reason
