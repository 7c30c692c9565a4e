"""The robot suite from end to end in real simulation, small; resuming; names; workers that die."""

import json
import os
import signal
import threading
import time
from pathlib import Path

import pytest

from gvla2.commands.bench import run_bench
from gvla2.errors import ConfigurationError, Gvla2Error, PlannerTimeoutError
from gvla2.evaluation.engine import in_processes
from gvla2.evaluation.suites import robot_episodes
from tests.composing import bench_config
from tests.dying import dies, dies_once, sleeps
from tests.quick import QUICK

pytest.importorskip("sapien", exc_type=ImportError)

ROW = {"task", "arm", "profile", "seed", "episode", "success", "failure", "seconds"}


def config_of(registry, folder: Path, *overrides: str, sight: tuple[str, ...] = QUICK):
    config = bench_config(
        registry, "suite=robot", "conditions=clean", "quiet=true", "workers=1", *sight, *overrides
    )
    config.results.url = f"sqlite:///{folder / 'results.sqlite'}"
    return config


def rows_of(folder: Path) -> list[dict]:
    return json.loads((folder / "result.json").read_text())["rows"]


def test_arms_learn_from_one_exploration_are_frozen_and_tested_on_the_same_layouts(registry, tmp_path):
    config = config_of(
        registry,
        tmp_path,
        "tasks=[pick_and_lift]",
        "arms=['off','on']",
        "episodes=1",
        "exploration_seeds=[3]",
        "films=all",
    )
    assert run_bench(config, registry, tmp_path / "first") == 1
    rows = rows_of(tmp_path / "first")
    assert len(rows) == 2 * 2, "arms x profiles"
    for row in rows:
        assert row.keys() >= ROW
        assert isinstance(row["success"], bool)
        assert bool(row["failure"]) != row["success"]
        assert 0 < row["seconds"] < 300
        assert row["perceiver"] == "oracle"
        assert not row["degraded"]
    assert {row["layout"] for row in rows} == {10_000}
    on = [row for row in rows if row["arm"] == "on"]
    assert any(row["recalled"] for row in on), "the bank was taught, and is read"
    assert all(row["recalled"] or row["abstained"] for row in on)
    assert not any(row["recalled"] for row in rows if row["arm"] == "off")
    assert (tmp_path / "first" / "banks" / "plain" / "on.db").is_file()
    page = (tmp_path / "first" / "index.html").read_text()
    assert "what memory adds" in page
    for arm in ("off", "on"):
        folder = tmp_path / "first" / "episodes" / "pick_and_lift" / f"{arm}_10000"
        assert (folder / "episode.mp4").stat().st_size > 0
        assert (folder / "index.html").is_file()

    # All of it is in the database: nothing is run again, and the rows are the same.
    assert run_bench(config, registry, tmp_path / "second") == 1
    assert rows_of(tmp_path / "second") == rows
    assert not (tmp_path / "second" / "banks").exists()


def test_arms_that_move_alike_share_a_simulation_and_have_what_they_would_have_had(
    registry, tmp_path, monkeypatch
):
    moved, real = [], robot_episodes.run_episode
    monkeypatch.setattr(robot_episodes, "run_episode", lambda *given: moved.append(given) or real(*given))
    config = config_of(
        registry, tmp_path, "world=learnable", "seeds=[4]", "families=1", "tasks=[open_box]", "episodes=1",
        "exploration_seeds=[0]", "exploration_replan=2", "second_tries=0", "embedder=static",
        "arms=['off','on','awm','no_replay','retry']",
        "+own_arms.no_replay={memory: governed, replay: false}", "+own_arms.retry={memory: 'off', replan: 1}",
    )  # fmt: skip

    def measured(name: str) -> tuple[list[tuple], int]:
        moved.clear()
        assert run_bench(config, registry, tmp_path / name) == 1
        same = ("arm", "success", "failure", "message", "verdict", "parameters", "recalled")
        return [tuple(str(row[key]) for key in same) for row in rows_of(tmp_path / name)], len(moved)

    shared, few = measured("shared")
    assert few == 1 + 3, "exploration; off, which is awm's too; on, which is no_replay's too; and retry"
    config.results.fresh = True
    monkeypatch.setattr(robot_episodes, "_alike", lambda *given: None)
    assert measured("alone") == (shared, 1 + 5)
    assert len(shared) == 2 * 5


def test_only_failures_are_filmed_where_only_these_are_wanted(registry, tmp_path):
    place, done = tmp_path / "episodes" / "pick_and_lift" / "off_5", []
    for slips in ([], ["robot.grip_force=0.1"]):
        tasks = ["tasks=[pick_and_lift]", "arms=['off']", "layouts=[5]", "films=failures"]
        assert run_bench(config_of(registry, tmp_path, *tasks, *slips), registry, tmp_path) == 1
        (row,) = [row for row in rows_of(tmp_path) if row["profile"] == "relaxed"]
        done.append(row["success"])
        assert (place / "episode.mp4").is_file() is not row["success"]
        assert bool(row["folder"]) is not row["success"]
    origin = json.loads((place / "result.json").read_text())["origin"]
    assert origin["version"]
    assert origin["options"]["robot.grip_force"] == 0.1
    assert "<span>robot.grip_force</span>0.1" in (place / "index.html").read_text()
    assert done == [True, False]


def test_the_work_of_a_process_that_died_is_done_again_and_counted_once(tmp_path):
    tasks = ["a", "b", str(tmp_path / "flag"), "c", "d"]
    answers = list(in_processes(dies_once, tasks, 2, tries=3))
    assert sorted(answers) == sorted((task, task.upper()) for task in tasks)
    deadly = [str(tmp_path / name) for name in ("one", "two", "three")]
    assert len(list(in_processes(dies_once, ["a", *deadly], 1, tries=2))) == 4, (
        "each death after some progress"
    )
    with pytest.raises(Gvla2Error, match="worker process died"):
        list(in_processes(dies, [1], 1))


def test_a_bench_that_is_terminated_ends_its_workers_at_once(tmp_path):
    def shown(_signal: int, _frame: object) -> None:
        raise KeyboardInterrupt

    def terminate() -> None:
        while len(list(tmp_path.iterdir())) < 2:
            time.sleep(0.1)
        os.kill(os.getpid(), signal.SIGTERM)

    before = signal.signal(signal.SIGTERM, shown)
    threading.Thread(target=terminate, daemon=True).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            list(in_processes(sleeps, [str(tmp_path)] * 4, 2))
    finally:
        signal.signal(signal.SIGTERM, before)
    workers = [int(found.name) for found in tmp_path.iterdir()]
    assert len(workers) == 2
    for worker in workers:
        with pytest.raises(ProcessLookupError):
            os.kill(worker, 0)


def test_an_episode_whose_planner_is_late_is_not_measured_and_measured_next_time(
    registry, tmp_path, monkeypatch
):
    from gvla2_plugins.skill.planner import SkillPlanner

    real, asked = SkillPlanner.plan, []

    def late_at_first(self, request):
        asked.append(request)
        if len(asked) == 1:
            raise PlannerTimeoutError("The planner 'skill' gave no answer within 1 s.")
        return real(self, request)

    monkeypatch.setattr(SkillPlanner, "plan", late_at_first)
    config = config_of(registry, tmp_path, "tasks=[pick_and_lift]", "arms=['off']", "episodes=2")
    run_bench(config, registry, tmp_path / "first")
    rows = [row for row in rows_of(tmp_path / "first") if row["profile"] == "relaxed"]
    assert [row["success"] for row in rows] == [None, True]
    assert rows[0]["status"] == "not measured: timeout"
    page = (tmp_path / "first" / "index.html").read_text()
    assert "1/1" in page, "what was not measured counts for nobody"
    assert "not measured" in page
    run_bench(config, registry, tmp_path / "second")
    rows = [row for row in rows_of(tmp_path / "second") if row["profile"] == "relaxed"]
    assert [row["success"] for row in rows] == [True, True]
    assert len(asked) == 3, "only the late one is measured again"


def test_arms_do_not_learn_from_exploration_with_gaps(registry, tmp_path, monkeypatch):
    from gvla2_plugins.skill.planner import SkillPlanner

    def late(self, request):
        raise PlannerTimeoutError("The planner 'skill' gave no answer within 1 s.")

    monkeypatch.setattr(SkillPlanner, "plan", late)
    config = config_of(
        registry,
        tmp_path,
        "tasks=[lamp_on]",
        "arms=['off','on']",
        "episodes=1",
        "exploration_seeds=[0]",
        "workers=1",
    )
    with pytest.raises(Gvla2Error, match="1 of 1 explored episodes could not be measured"):
        run_bench(config, registry, tmp_path / "out")


def test_arms_learn_from_the_others_where_one_task_cannot_be_set_up(registry, tmp_path, monkeypatch):
    from gvla2_plugins.tabletop.lift import LampOn

    def too_large(self, rng, site, instruction=None):
        raise ConfigurationError("No place was found for a lamp.")

    monkeypatch.setattr(LampOn, "sample", too_large)
    tasks, arms = ("tasks=[lamp_on,push_block]", "exploration_seeds=[0]"), ("arms=[off,on]", "episodes=1")
    run_bench(config_of(registry, tmp_path, *tasks, *arms, "workers=1"), registry, tmp_path / "out")
    found = {(row["task"], row["arm"]): row["status"] for row in rows_of(tmp_path / "out")}
    assert {found["lamp_on", arm] for arm in ("off", "on")} == {"not measured: setup"}
    assert {found["push_block", arm] for arm in ("off", "on")} == {"ok"}
