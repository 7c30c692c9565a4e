"""Planners that hang or talk rubbish: a typed failure, and the next episode of the run is as good as ever."""

import json
from dataclasses import replace

import pytest

from gvla2.commands.run import run_episodes
from gvla2.planning.contracts import Plan
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2_plugins.skill.planner import SkillPlanner
from tests.quick import QUICK

SMALL = (*QUICK, "memory=none", "robot.video_fps=1", "seed=1")
SOMEWHERE = Waypoint((0.3, 0.0, 0.9), 1.0, "approach")
NOWHERE = replace(SOMEWHERE, xyz=(float("nan"), 0.0, 0.9))


@pytest.fixture
def run_of_two(registry, compose_run, tmp_path, monkeypatch):
    """Two episodes, in the first of which the planner answers by ``wrong``: their rows, and what it was asked."""
    real = SkillPlanner.plan

    def start(wrong, *overrides):
        requests = []

        def plan(self, request):
            requests.append(request)
            first = len({id(r.observation) for r in requests}) == 1
            return wrong(self, request) if first else real(self, request)

        monkeypatch.setattr(SkillPlanner, "plan", plan)
        out = tmp_path / "out"
        run_episodes(compose_run("episodes=2", *SMALL, *overrides), registry, out)
        return json.loads((out / "result.json").read_text())["rows"], requests

    return start


def test_a_planner_that_hangs_ends_its_episode_and_no_other(run_of_two):
    def hang(self, request):
        while True:
            pass

    (first, second), requests = run_of_two(hang, "planner_timeout=5")
    assert (first["failure"]["stage"], first["failure"]["kind"]) == ("plan", "timeout")
    assert "'skill' gave no answer within 5 s" in first["failure"]["message"]
    assert first["success"] is False
    assert second["success"] is True
    assert len(requests) == 2  # one that hangs is not asked twice


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda self, r: {"waypoints": []}, "dict, not a Plan"),
        (lambda self, r: Plan(Trajectory((NOWHERE, NOWHERE))), "a finite number"),
        (
            lambda self, r: Plan(Trajectory((replace(NOWHERE, xyz=(0.3, 0.0, 0.9)),) * 10_000)),
            "10000 waypoints",
        ),
    ],
    ids=["type", "nan", "many"],
)
def test_rubbish_is_the_failure_and_the_next_episode_goes_on(run_of_two, answer, words):
    (first, second), requests = run_of_two(answer)
    assert (first["failure"]["stage"], first["failure"]["kind"]) == ("plan", "invalid_plan")
    assert words in first["failure"]["message"]
    assert second["success"] is True
    assert len(requests) == 2, "a planner that does not return plans is not asked again"
