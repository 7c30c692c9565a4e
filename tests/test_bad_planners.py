"""Planners that hang or talk rubbish: a typed failure, and the next episode of the run is as good as ever."""

import json
from dataclasses import replace

import pytest

from gvla2.commands.run import run_episodes
from gvla2.planning.contracts import Plan
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2_plugins.skill.planner import SkillPlanner
from tests.quick import QUICK

SMALL = (*QUICK, "memory=none", "seed=1")
SOMEWHERE = Waypoint((0.3, 0.0, 0.9), 1.0, "approach")
NOWHERE = replace(SOMEWHERE, xyz=(float("nan"), 0.0, 0.9))


@pytest.fixture
def run(registry, compose_run, tmp_path, monkeypatch):
    """An episode for each of ``wrong``, by which the planner answers it, and one more: their rows and its requests."""
    real = SkillPlanner.plan

    def start(*wrong, **options):
        requests, left = [], iter(wrong)

        def plan(self, request):
            requests.append(request)
            return next(left, real)(self, request)

        monkeypatch.setattr(SkillPlanner, "plan", plan)
        out, given = tmp_path / "out", [f"{name}={value}" for name, value in options.items()]
        run_episodes(compose_run(f"episodes={len(wrong) + 1}", *SMALL, *given), registry, out)
        *failed, last = json.loads((out / "result.json").read_text())["rows"]
        assert last["success"] is True
        assert len(requests) == len(wrong) + 1, "a planner that returned no plan is not asked again"
        return failed

    return start


def test_a_planner_that_hangs_ends_its_episode_and_no_other(run):
    def hang(self, request):
        while True:
            pass

    (row,) = run(hang, planner_timeout=3)
    assert (row["failure"]["stage"], row["failure"]["kind"]) == ("plan", "timeout")
    assert "'skill' gave no answer within 3 s" in row["failure"]["message"]
    assert row["success"] is False


def test_rubbish_is_the_failure_and_the_next_episode_goes_on(run):
    rubbish = {
        "dict, not a Plan": {"waypoints": []},
        "a finite number": Plan(Trajectory((NOWHERE, NOWHERE))),
        "10000 waypoints": Plan(Trajectory((SOMEWHERE,) * 10_000)),
    }
    rows = run(*(lambda self, request, answer=answer: answer for answer in rubbish.values()))
    for row, words in zip(rows, rubbish, strict=True):
        assert (row["failure"]["stage"], row["failure"]["kind"]) == ("plan", "invalid_plan")
        assert words in row["failure"]["message"]
