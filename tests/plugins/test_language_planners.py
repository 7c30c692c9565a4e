"""What all planners that ask a language model have in common, over real HTTP."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gvla2.errors import ConfigurationError
from gvla2.language import LanguageModelError
from gvla2.testing.language import LocalModel, refused, said
from gvla2_plugins import agent3d, code_policies, hamster, robopoint, voxposer
from tests.plugins.scripted_planners import REQUEST, ScriptedPlanner

PLANNERS = {
    "agent3d": ScriptedPlanner(agent3d.gvla2_planners, agent3d.Agent3dConfig),
    "code_policies": ScriptedPlanner(code_policies.gvla2_planners, code_policies.CodePoliciesConfig),
    "hamster": ScriptedPlanner(hamster.gvla2_planners, hamster.HamsterConfig),
    "robopoint": ScriptedPlanner(robopoint.gvla2_planners, robopoint.RoboPointConfig),
    "voxposer": ScriptedPlanner(voxposer.gvla2_planners, voxposer.VoxPoserConfig),
}


@pytest.mark.parametrize("name", PLANNERS)
def test_nothing_is_asked_about_nothing(name):
    with LocalModel(lambda _: said("pick(red_cube)")) as model:
        planner = PLANNERS[name].at(model)
        assert planner.plan(replace(REQUEST, instruction=" ")).abstention.kind == "unknown_skill"
        empty = replace(REQUEST.scene, objects=())
        assert planner.plan(replace(REQUEST, scene=empty)).abstention.kind == "nothing_matches"
        assert not model.requests


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("answering", [lambda _: refused(503, "busy"), lambda _: refused(401, "no key")])
def test_a_server_that_fails_is_a_failure_of_the_model(name, answering):
    with LocalModel(answering) as model:
        planner = PLANNERS[name].at(model)
        with pytest.raises(LanguageModelError):
            planner.plan(REQUEST)
    with pytest.raises(LanguageModelError, match="cannot be reached"):  # nobody is there any more
        planner.plan(REQUEST)


@pytest.mark.parametrize(
    ("config", "options"),
    [
        *((agent3d.Agent3dConfig, o) for o in ({"tries": 0}, {"waypoints": "polar"}, {"points": -1})),
        *(
            (code_policies.CodePoliciesConfig, o)
            for o in ({"agreement": 2.0}, {"programs": -1}, {"calls": 0})
        ),
        *((hamster.HamsterConfig, o) for o in ({"longest": 3}, {"scale": 0.0}, {"travel": 2.0})),
        *((robopoint.RoboPointConfig, o) for o in ({"tries": 0}, {"agreement": 0.0})),
        *((voxposer.VoxPoserConfig, o) for o in ({"margin": 0.0}, {"obstacles": float("nan")})),
    ],
)
def test_options_out_of_range_are_refused(config, options):
    with pytest.raises(ConfigurationError):
        config(**options)
