"""The language of value maps: what its expressions mean, and that nothing else is run."""

import time

import numpy as np
import pytest

from gvla2.testing import inputs
from gvla2_plugins.voxposer.maps import LONGEST, MOST_STAGES, MapInterpreter, read_program
from gvla2_plugins.voxposer.voxel_route import VoxelGrid

SCENE = inputs.scene()
IDS = {o.id: o.id for o in SCENE.objects}
CENTRES = VoxelGrid.over(inputs.WORKSPACE, 0.02).centres()
CUBE = SCENE["red_cube"]


def value(expression, points=CENTRES, lines=""):
    program = read_program(f"{lines}\nmove('m', affordance={expression})")
    return MapInterpreter(SCENE, IDS, program, points).values(program.stages[0]["affordance"])


def point(*mm):
    """A world point given in millimetres above the table."""
    return np.array([[mm[0] / 1e3, mm[1] / 1e3, inputs.TABLE + mm[2] / 1e3]])


@pytest.mark.parametrize(
    ("expression", "number"),
    [
        ("x", 300.0),
        ("z", 100.0),
        ("red_cube.height", 52.0),
        ("red_cube.x - x", 0.0),
        ("red_cube.y", -80.0),
        ("distance(red_cube)", 48.0),
        ("at(red_cube)", -74.0),
        ("above(red_cube, 48)", 0.0),
        ("beside(red_cube, 0, 0, 74)", 0.0),
        ("near(red_cube, 96)", 0.5),
        ("where(z > 50, 1, 0) * 2 ** 3", 8.0),
        ("-abs(min(x, 4) - max(1, 6))", -2.0),
        ("(x > 0) and (y > 0)", 0.0),
        ("(x > 0) | (y > 0)", 1.0),
        ("sqrt(16) + exp(0) + clip(9, 0, 1)", 6.0),
    ],
)
def test_what_expressions_mean(expression, number):
    assert value(expression, point(300, -80, 100))[0] == pytest.approx(number, abs=1e-6)


def test_variables_are_worked_out_once():
    """Each line doubles the work where they are not: 2^24 evaluations of a grid would never end."""
    lines = "a0 = x\n" + "\n".join(f"a{i} = a{i - 1} + a{i - 1}" for i in range(1, 25))
    began = time.perf_counter()
    assert value("a24", point(1, 0, 0), lines)[0] == pytest.approx(2.0**24)
    assert time.perf_counter() - began < 1.0


def test_prose_around_a_program_and_its_names():
    program = read_program(
        "Sure:\n```python\nmove('go up', affordance=z)\nmove(affordance=z, speed=2)\n```\nDone."
    )
    assert [set(maps) for maps in program.stages] == [{"affordance"}, {"affordance", "speed"}]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "0 moves"),
        ("I would first grasp the cube.", "cannot be read"),
        ("__import__('os').system('true')", "neither move"),
        ("for i in x: pass", "neither move"),
        ("x = 3\nmove('a', affordance=x)", "'x' has a meaning already"),
        ("move('a')", "a move has a name, an affordance"),
        ("move('a', affordance=z, force=3)", "and of affordance, avoidance, rotation, gripper, speed"),
        ("move('a', affordance=z)\n" * (MOST_STAGES + 1), f"write 1 to {MOST_STAGES}"),
        ("move('a', affordance=" + "-" * 900 + "z)", "too long"),
        ("(" * 3000, "cannot be read"),
        ("x" * (LONGEST + 1), f"write at most {LONGEST}"),
        ("move('a', affordance=z", "cannot be read"),
    ],
)
def test_what_is_no_program(text, said):
    with pytest.raises(ValueError, match=said):
        read_program(text)


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("at(green_ball)", "no object 'green_ball'; there are red_cube, blue_cube"),
        ("at()", "does not take these 0 arguments"),
        ("above(red_cube, x)", "does not take these 2 arguments"),
        ("min(1, 2, z)", "does not take these 3 arguments"),
        ("red_cube.__class__", "no '__class__'; they have x, y, z"),
        ("red_cube.points", "no 'points'"),
        ("open('/etc/passwd')", r"no open\(\)"),
        ("[z for z in range(9)]", "not allowed here"),
        ("z[0]", "not allowed here"),
        ("exp(x, out=z)", "not allowed here"),
        ("x / 0", "not finite"),
        ("9 ** 9 ** 9", "not finite"),
        ("q", "nested too deeply"),
    ],
)
def test_what_is_no_expression(expression, said):
    lines = "q = q + 1"
    with pytest.raises(ValueError, match=said):
        value(expression, lines=lines)


def test_metres_are_no_lengths():
    with pytest.raises(ValueError, match="millimetres"):
        value("above(red_cube, 0.1)")
