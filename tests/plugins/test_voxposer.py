"""VoxPoser over real HTTP: scripted programs of value maps, from the answer to a plan that the checks pass."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.testing import check_component, check_planner, inputs
from gvla2_plugins.voxposer import VoxPoserConfig, gvla2_planners
from gvla2_plugins.voxposer.planner import read_program, stops
from tests.local_model import LocalModel, said
from tests.plugins.scripted_planners import REQUEST, ScriptedPlanner, passes

LIFT = """move("grasp", affordance=at(red_cube), gripper=0)
move("raise", affordance=above(red_cube, 150))"""
PUSH = """move("beside it", affordance=beside(red_cube, 0, -90, -5), gripper=0)
move("push", affordance=beside(red_cube, 0, 70, -5))"""
OTHER = LIFT.replace("red", "blue")
IDS = {o.id: o.id for o in REQUEST.scene.objects}


SCRIPTED = ScriptedPlanner(gvla2_planners, VoxPoserConfig)
planner, planned = SCRIPTED.at, SCRIPTED.planned


def test_it_is_a_planner_as_any_other():
    (component,) = gvla2_planners()
    check_component(component)
    with LocalModel(lambda _: said(LIFT)) as model:
        check_planner(planner(model))


def test_maps_of_a_lift_take_the_object_up():
    plan = planned(f"```python\n{LIFT}\n```")
    assert (plan.skill, plan.roles) == ("pick", {"theme": "red_cube"})
    passes(plan)
    last = plan.trajectory.waypoints[-1]
    assert last.carries == "red_cube"
    assert last.xyz[2] == pytest.approx(REQUEST.scene["red_cube"].top + 0.15, abs=0.03)
    assert LIFT in plan.transcript[0]["answer"]


def test_a_closed_hand_pushes():
    plan = planned(PUSH)
    assert (plan.skill, plan.roles["theme"]) == ("push", "red_cube"), plan.abstention
    passes(plan)


def way_between(avoidance):
    """The way from over the one end of the table to the other, and the cubes between them."""
    program = read_program(f"move('go', affordance=-abs(x - 320) - abs(y - 350) - abs(z - 30){avoidance})")
    request = replace(REQUEST, start=rigid(REQUEST.start[:3, :3], (0.32, -0.35, inputs.TABLE + 0.03)))
    way = stops(program, request, IDS, VoxPoserConfig())
    points = np.array([request.start[:3, 3], *(s.xyz for s in way)])
    return np.vstack([np.linspace(a, b, 100) for a, b in pairwise(points)])


def test_ways_keep_away_from_objects_and_from_what_the_model_avoids():
    free = way_between("")
    for obj in REQUEST.scene.objects:
        level = np.linalg.norm((free - obj.centre)[:, :2], axis=1)
        inside = (level < 0.026) & (free[:, 2] < obj.top)
        assert not inside.any()
    high = way_between(", avoidance=(z < 200) * (abs(y) < 200)")
    middle = np.abs(high[:, 1]) < 0.15
    assert high[middle, 2].min() > inputs.TABLE + 0.18
    assert free[np.abs(free[:, 1]) < 0.15, 2].min() < inputs.TABLE + 0.18


def test_a_gripper_map_says_where_the_hand_closes():
    program = read_program("move('grasp', affordance=at(red_cube), gripper=distance(red_cube) > 20)")
    way = stops(program, REQUEST, IDS, VoxPoserConfig())
    assert way[-1].gripper == 0.0
    constant = stops(read_program(LIFT), REQUEST, IDS, VoxPoserConfig())
    assert [s.gripper for s in constant][-1] == 0.0


@pytest.mark.parametrize(
    ("program", "said_"),
    [
        ("First, grasp the cube.", "cannot be read"),
        ('move("a", affordance=at(nothing))', "no object 'nothing'"),
        ('move("a", affordance=1)', "same everywhere"),
        ('move("a", affordance=at(red_cube), gripper=0 / 0)', "not finite"),
        ('move("a", affordance=above(red_cube, 200), gripper=0)', "nothing"),
        ('__import__("os").system("true")', "is not move"),
        (f'{LIFT}\nmove("drop", affordance=above(red_cube, 300), gripper=1)\n{OTHER}', "closes 2 times"),
    ],
)
def test_bad_answers_move_nothing(program, said_):
    plan = planned(program, tries=2)
    assert plan.trajectory is None
    assert plan.abstention.kind in ("other", "unreachable")
    assert said_ in plan.abstention.message
    assert len(plan.transcript) == 2
