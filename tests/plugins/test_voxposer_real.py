"""VoxPoser with a real language model: its programs are of the language, and the plan is one that the checks pass."""

import pytest

from gvla2.planning.checks import check_trajectory
from gvla2.testing import inputs
from gvla2_plugins.voxposer import VoxPoserConfig
from gvla2_plugins.voxposer.maps import read_program
from gvla2_plugins.voxposer.planner import VoxPoserPlanner

pytestmark = [pytest.mark.model, pytest.mark.timeout(900)]


def test_a_small_model_writes_value_maps(local_model, registry, tmp_path):
    root = {
        "language": {
            "name": "llama_cpp",
            "model": str(local_model),
            "folder": str(tmp_path),
            "timeout": 600.0,
        }
    }
    planner = VoxPoserPlanner(VoxPoserConfig(tries=2), registry.build(root, "language"))
    request = inputs.plan_request("lift the red cube")
    plan = planner.plan(request)
    assert read_program(plan.transcript[0]["answer"]).stages
    assert plan.trajectory is not None, plan.abstention
    assert plan.roles["theme"] == "red_cube"
    report = check_trajectory(plan.trajectory, request.scene, request.arm, request.start, request.joints)
    assert report.passed, report.reasons
