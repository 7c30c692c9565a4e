"""The planner with a real language model: what it writes is read, and the checks pass its plan."""

import pytest

from gvla2.planning.checks import check_trajectory
from gvla2.testing import inputs

pytestmark = [pytest.mark.model, pytest.mark.timeout(900)]


def test_a_small_model_lifts_the_red_cube(local_model, registry, tmp_path):
    root = {
        "language": {
            "name": "llama_cpp",
            "model": str(local_model),
            "folder": str(tmp_path),
            "timeout": 600.0,
        },
        "planner": {"name": "code_policies"},
    }
    request = inputs.plan_request("lift the red cube")
    plan = registry.build(root, "planner").plan(request)
    assert not plan.transcript[-1]["rejected"]
    assert plan.trajectory is not None, plan.abstention
    assert plan.roles["theme"] == "red_cube"
    report = check_trajectory(plan.trajectory, request.scene, request.arm, request.start, request.joints)
    assert report.passed, report.reasons
