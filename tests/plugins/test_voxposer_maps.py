"""The language of value maps, of which nothing else is run; and the ways through grids of costs."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gvla2.planning.scene import Box
from gvla2.testing import inputs
from gvla2_plugins.voxposer.planner import LONGEST, MOST_STAGES, MapInterpreter, VoxelGrid, read_program

SCENE = inputs.scene()
IDS = {o.id: o.id for o in SCENE.objects}
CENTRES = VoxelGrid.over(inputs.WORKSPACE, 0.02).centres()
CUBE = SCENE["red_cube"]


def value(expression, points=CENTRES):
    (move,) = read_program(f"move('m', affordance={expression})")
    return MapInterpreter(SCENE, IDS, points).values(move["affordance"])


def point(*mm):
    """A world point given in millimetres above the table."""
    return np.array([[mm[0] / 1e3, mm[1] / 1e3, inputs.TABLE + mm[2] / 1e3]])


@pytest.mark.parametrize(
    ("expression", "number"),
    [
        ("x", 300.0),
        ("z", 100.0),
        ("red_cube.height", 52.0),
        ("distance(red_cube)", 48.0),
        ("at(red_cube)", -74.0),
        ("above(red_cube, 48)", 0.0),
        ("beside(red_cube, 0, 0, 74)", 0.0),
        ("near(red_cube, 96)", 0.5),
        ("where(z > 50, 1, 0) * 2 ** 3", 8.0),
        ("-abs(min(x, 4) - max(1, 6))", -2.0),
        ("(x > 0) | (y > 0)", 1.0),
        ("sqrt(16) + exp(0) + clip(9, 0, 1)", 6.0),
    ],
)
def test_what_expressions_mean(expression, number):
    assert value(expression, point(300, -80, 100))[0] == pytest.approx(number, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "0 moves"),
        ("__import__('os').system('true')", "is not move"),
        ("a = 3\nmove('a', affordance=a)", "is not move"),
        ("move('a')", "a move has a name, an affordance"),
        ("move('a', affordance=z, force=3)", "and of affordance, avoidance, gripper"),
        ("move('a', affordance=z)\n" * (MOST_STAGES + 1), f"write 1 to {MOST_STAGES}"),
        ("move('a', affordance=" + "-" * 900 + "z)", "too long"),
        ("(" * 3000, "cannot be read"),
        ("x" * (LONGEST + 1), f"write at most {LONGEST}"),
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
        ("red_cube.__class__", "no '__class__'; they have x, y, z"),
        ("open('/etc/passwd')", r"no open\(\)"),
        ("[z for z in range(9)]", "not allowed here"),
        ("exp(x, out=z)", "not allowed here"),
        ("9 ** 9 ** 9", "not finite"),
        ("q", "not allowed here"),
        ("above(red_cube, 0.1)", "millimetres"),
    ],
)
def test_what_is_no_expression(expression, said):
    with pytest.raises(ValueError, match=said):
        value(expression)


# Ways through grids whose cheapest way is known

GRID = VoxelGrid.over(Box(np.zeros(3), np.array([1.0, 0.6, 0.4])), 0.02)
A, B = np.array([0.1, 0.3, 0.1]), np.array([0.9, 0.3, 0.1])


def length(way):
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def test_it_goes_round_a_wall_and_not_farther_than_it_must():
    costs = np.ones(GRID.shape)
    wall = slice(24, 26), slice(8, 30), slice(0, 20)  # a gap at low y
    costs[wall] = 1000.0
    way = GRID.route(costs, A, B)
    assert 2 < len(way) <= 8
    corner = np.array([0.5, 0.16, 0.1])
    shortest = np.linalg.norm(corner - A) + np.linalg.norm(B - corner)
    assert shortest - 0.03 < length(way) < 1.05 * shortest
    dense = np.vstack([np.linspace(p, q, 200) for p, q in pairwise(way)])
    assert costs[tuple(GRID.indices(dense).T)].max() == 1.0


def test_clearance_is_the_distance_to_the_grown_box():
    cube = inputs.scene(inputs.RED)["red_cube"]
    cube = replace(
        cube, world_from_object=np.eye(4) + np.pad(np.array([[0.5], [0.3], [0.1]]), ((0, 1), (3, 0)))
    )
    far = GRID.clearance([cube], grown=0.02)
    at = tuple(GRID.indices(np.array([0.7, 0.3, 0.1])))
    assert far[at] == pytest.approx(0.2 - 0.026 - 0.02, abs=0.03)
    assert far[tuple(GRID.indices(np.array([0.5, 0.3, 0.1])))] == 0.0
    assert np.isinf(GRID.clearance([])).all()


def test_a_peak_is_found_finer_than_the_grid():
    wanted = np.array([0.413, 0.277, 0.133])
    found = GRID.peak(lambda p: -np.linalg.norm(p - wanted, axis=-1), np.zeros(GRID.shape))
    assert np.linalg.norm(found - wanted) < 0.15 * GRID.size


def test_of_equal_peaks_the_least_avoided_is_taken_and_its_middle():
    def high(points):
        return np.where(np.abs(points[..., 0] - 0.5) > 0.3, 1.0, 0.0)

    avoided = np.zeros(GRID.shape)
    avoided[:25] = 1.0
    found = GRID.peak(high, avoided)
    np.testing.assert_allclose(found, [0.9, 0.3, 0.2], atol=0.03)
    with pytest.raises(ValueError, match="the same everywhere"):
        GRID.peak(lambda p: np.zeros(p.shape[:-1]), avoided)
