"""The planners that ask a language model, with the real one that scripts/fetch_model brings."""

import pytest

from gvla2.testing import inputs
from tests.plugins.scripted_planners import passes

pytestmark = [pytest.mark.model, pytest.mark.timeout(900)]


@pytest.mark.parametrize("planner", ["agent3d", "code_policies", "voxposer"])
def test_a_small_model_lifts_the_red_cube(planner, local_model, registry):
    language = {"name": "llama_cpp", "model": str(local_model), "timeout": 600.0}
    request = inputs.plan_request("lift the red cube")
    plan = registry.build({"language": language, "planner": {"name": planner}}, "planner").plan(request)
    assert not plan.transcript[-1]["rejected"]
    passes(plan, request)
    assert plan.roles["theme"] == "red_cube"
