"""Remembered paths: what a skill did can be followed as waypoints, and what cannot be followed is not shown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Advice
from gvla2.planning.programs import Program, relative_steps, waypoints_program
from gvla2.planning.scene_brief import scene_brief
from gvla2.skills.carry_out import carry_out
from gvla2_plugins.agent3d.waypoint_programs import remembered_paths
from tests.skills.scenes import PATCH, POST, RING, TRAY, cube, make_object, request, sound

A = cube("a", (0.3, 0.1))


def shown(asked, *programs):
    """The remembered paths of a request with these programs."""
    asked = replace(asked, advice=Advice(programs=programs))
    return remembered_paths(asked, scene_brief(asked.scene), 2, SkillOptions())


def path_of_skill(call, asked):
    """The path of a call's plan, as memory keeps it."""
    plan = sound(carry_out([call], asked), asked)
    steps = relative_steps(plan.trajectory, asked.scene, plan.roles)
    return waypoints_program(steps, asked.scene, roles=plan.roles, skill=plan.skill, instruction="do it")


@pytest.mark.parametrize(
    ("call", "objects"),
    [
        (SkillCall("place", "a", "tray", relation="in"), (A, TRAY)),
        (SkillCall("insert", "ring", "post"), (RING, POST)),
        (SkillCall("push", "a", "patch"), (A, PATCH)),
    ],
)
def test_the_path_of_a_skill_can_be_followed_where_it_was_taken(call, objects):
    asked = request(*objects)
    assert len(shown(asked, path_of_skill(call, asked))) == 1


def test_a_path_that_leads_nowhere_here_is_not_shown():
    asked = request(A, PATCH)
    path = path_of_skill(SkillCall("place", "a", "patch"), asked)
    beside = [list(step) for step in path.steps]
    for step in beside:
        step[1] = 300  # closes 30 cm beside the cube
    wrong = Program("waypoints", tuple(map(tuple, beside)), path.roles, path.skill, "do it")
    assert [one.steps for one in shown(asked, wrong, path)] == [one.steps for one in shown(asked, path)]
    assert not shown(asked, wrong)


def test_a_taller_object_is_carried_higher_over_the_goal():
    low, tall = (make_object("a", "box", (0.3, 0.1, h / 2), (0.05, 0.05, h)) for h in (0.05, 0.12))
    path = path_of_skill(SkillCall("place", "a", "patch"), request(low, PATCH))
    (here,), (there,) = shown(request(low, PATCH), path), shown(request(tall, PATCH), path)
    (low_down, tall_down) = (one.steps[-1][-2] for one in (here, there))
    held = [one.steps[2][-2] for one in (here, there)]
    assert tall_down - low_down == pytest.approx(70 + held[1] - held[0], abs=2)  # as far above the patch
