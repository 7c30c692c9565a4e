"""Parameters varied on purpose, and which of them go with the object's size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gvla2.planning.contracts import Advice, Plan, PlanRequest
from gvla2.planning.effects import Bound
from gvla2.skills.carry_out import LEAST, MOST, SPEEDS, varied
from gvla2.skills.parameters import scales
from gvla2.skills.table import STANDARD
from gvla2.testing import inputs
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.planner import SkillPlanner

THETA = {"standoff": 0.05, "approach_tilt": 0.0, "grasp_depth": 0.02, "lift_height": 0.2, "speed": 0.25,
         "contact_speed": 0.08}  # fmt: skip


@pytest.fixture(scope="module")
def asked() -> PlanRequest:
    return inputs.plan_request()


def plan(request: PlanRequest, **options: float) -> Plan:
    return SkillPlanner(SkillConfig(**options)).plan(request)


def ratios(theta: dict[str, float]) -> dict[str, float]:
    return {name: theta[name] / value for name, value in THETA.items() if value}


def test_all_but_the_speeds_and_what_was_said_varies_within_half(asked):
    drawn = [varied(THETA, 0.3, seed, asked, "a", frozenset({"lift_height"}))[0] for seed in range(60)]
    for theta in drawn:
        assert all(theta[name] == THETA[name] for name in (*SPEEDS, "lift_height", "approach_tilt"))
        assert all(LEAST - 1e-9 <= r <= MOST + 1e-9 for r in ratios(theta).values())
    logs = np.log([[ratios(theta)[n] for n in ("standoff", "grasp_depth")] for theta in drawn])
    assert 0.15 < logs.std() < 0.35
    assert abs(logs.mean()) < 0.12
    assert abs(np.corrcoef(logs.T)[0, 1]) < 0.4  # each has a factor of its own


def test_the_same_scene_and_seed_repeat_and_others_differ(asked):
    first = varied(THETA, 0.3, 1, asked, "a")
    assert varied(THETA, 0.3, 1, asked, "a") == first
    assert varied({**THETA, "turn": 1.0}, 0.3, 1, asked, "a")[0]["standoff"] == first[0]["standoff"]
    moved = replace(asked.scene.objects[0], world_from_object=asked.scene.objects[0].world_from_object + 0.01)
    elsewhere = replace(asked, scene=asked.scene.with_object(moved))
    for seed, request, theme in ((2, asked, "a"), (1, asked, "b"), (1, elsewhere, "a")):
        other = varied(THETA, 0.3, seed, request, theme)
        assert other[0] != first[0]
    assert all("to explore" in note for note in first[1])


def test_a_planner_that_explores_says_so_and_keeps_to_what_was_learned(asked):
    usual = plan(asked)
    assert usual.trajectory is not None
    assert replace(plan(asked, explore=0.0, explore_seed=9), options=usual.options) == usual
    tried = plan(asked, explore=0.3, explore_seed=3)
    assert tried.parameters != usual.parameters
    assert any("to explore" in note for note in tried.notes)
    assert all(tried.parameters[name] == usual.parameters[name] for name in SPEEDS)
    least = 1.2 * usual.parameters["standoff"]
    bound = Advice("", (Bound("standoff", least, source="r1"),))
    for seed in range(6):
        held = plan(replace(asked, advice=bound), explore=0.4, explore_seed=seed)
        assert held.parameters["standoff"] >= least


def test_plans_say_which_parameters_go_with_the_objects_height(asked):
    made = plan(asked)
    theme = asked.scene[made.roles["theme"]]
    assert made.scales["grasp_depth"] == ("height", pytest.approx(theme.top - theme.bottom))
    assert "standoff" not in made.scales
    sides = {"length": 0.1, "width": 0.05, "height": 0.04}
    # A pull's depth is that of the finger pads, whatever the drawer's height.
    assert scales(STANDARD["pull"].scaled, {"grasp_depth": 0.006}, sides) == {}
    assert scales(STANDARD["pick"].scaled, {"grasp_depth": 0.006}, {**sides, "height": 0.001}) == {}
