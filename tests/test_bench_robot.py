"""The robot suite from end to end in real simulation, small; resuming; names; workers that die."""

import json
import os
from pathlib import Path

import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.bench import run_bench
from gvla2.commands.bench_workers import in_processes
from gvla2.commands.primary import PRIMARY
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.hydra_bridge import register
from gvla2.plugins import load_plugins

pytest.importorskip("sapien", exc_type=ImportError)

ROW = {"task", "arm", "profile", "seed", "episode", "success", "failure", "seconds"}


@pytest.fixture(scope="module")
def registry():
    return load_plugins()


def config_of(registry, folder: Path, *overrides: str):
    register(registry, PRIMARY)
    given = [
        "suite=robot", f"results.url=sqlite:///{folder / 'results.sqlite'}", "quiet=true", "workers=1",
        "robot.image_size=160", *overrides,
    ]  # fmt: skip
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return OmegaConf.to_object(compose("bench", overrides=given))


def rows_of(folder: Path) -> list[dict]:
    return json.loads((folder / "result.json").read_text())["rows"]


def test_arms_learn_from_one_exploration_are_frozen_and_tested_on_the_same_layouts(registry, tmp_path):
    tasks = "tasks=[lamp_on,push_block]"
    arms = "arms=['off','on','shuffled','best_theta']"
    config = config_of(registry, tmp_path, tasks, arms, "episodes=1", "exploration_seeds=[3]")
    assert run_bench(config, registry, tmp_path / "first") == 1
    rows = rows_of(tmp_path / "first")
    assert len(rows) == 2 * 4 * 2, "tasks x arms x profiles"
    for row in rows:
        assert row.keys() >= ROW
        assert isinstance(row["success"], bool)
        assert bool(row["failure"]) != row["success"]
        assert 0 < row["seconds"] < 300
        assert row["perceiver"] == "classical"
        assert not row["degraded"]
    assert {row["layout"] for row in rows} == {10_000}
    on = [row for row in rows if row["arm"] == "on"]
    assert any(row["recalled"] for row in on), "the bank was taught, and is read"
    assert all(row["recalled"] or row["abstained"] for row in on)
    assert not any(row["recalled"] for row in rows if row["arm"] == "off")
    assert (tmp_path / "first" / "banks" / "on.db").is_file()
    page = (tmp_path / "first" / "index.html").read_text()
    assert "what memory adds" in page

    # All of it is in the database: nothing is run again, and the rows are the same.
    assert run_bench(config, registry, tmp_path / "second") == 1
    assert rows_of(tmp_path / "second") == rows
    assert not (tmp_path / "second" / "banks").exists()


def test_failed_episodes_are_filmed_once_more(registry, tmp_path):
    config = config_of(
        registry, tmp_path, "tasks=[lamp_on]", "arms=['off']", "episodes=1", 
        "scale=1.2", "depth_noise.kind=gaussian", "depth_noise.sigma_m=0.2",
    )  # fmt: skip
    run_bench(config, registry, tmp_path / "out")
    (row,) = [row for row in rows_of(tmp_path / "out") if row["profile"] == "eased"]
    assert not row["success"], "20 cm of noise hide a lamp"
    assert row["film_agrees"]
    assert (Path(row["film"]) / "index.html").is_file()
    assert row["failure"] in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("arms=[offf]", "No arm 'offf'. Available: off, "),
        ("tasks=[lamp_of]", "lamp_on"),
        ("exploration_seeds=[20000]", "exploration_seeds"),
        ("+arm_options.semantic.top_k=3 arms=['off']", "arm_options.semantic"),
    ],
)
def test_names_that_are_none_are_refused_before_anything_moves(registry, tmp_path, override, message):
    config = config_of(registry, tmp_path, *override.split())
    with pytest.raises(Gvla2Error, match=message):
        run_bench(config, registry, tmp_path / "out")


def test_scale_and_arms_are_checked():
    from gvla2.commands.bench_config import BenchConfig

    for wrong in ({"scale": 0.0}, {"arms": []}, {"episodes": 0}, {"exploration": 2.0}, {"videos": -1}):
        with pytest.raises(ConfigurationError):
            BenchConfig(**wrong)


def dies_once(flag: str) -> str:
    """Ends its process the first time it is called with a flag that is a file's name."""
    if flag.startswith("/") and not Path(flag).exists():
        Path(flag).touch()
        os._exit(3)
    return flag.upper()


def dies(_: int) -> None:
    os._exit(3)


def test_the_work_of_a_process_that_died_is_done_again_and_counted_once(tmp_path):
    tasks = ["a", "b", str(tmp_path / "flag"), "c", "d"]
    answers = list(in_processes(dies_once, tasks, 2, tries=3))
    assert sorted(answers) == sorted((task, task.upper()) for task in tasks)
    with pytest.raises(Gvla2Error, match="worker process died"):
        list(in_processes(dies, [1], 1, tries=2))
