"""A world that somebody else built, as a robot backend with tasks of its own."""

import json
import re
from contextlib import closing
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from gvla2 import Component, ComponentConfig, hookimpl, register, unregister
from gvla2.commands import worlds
from gvla2.commands.bench import run_bench
from gvla2.commands.hydra_job import composed
from gvla2.commands.run import run_episodes
from gvla2.errors import ConfigurationError, RobotError, SimulationError, UnknownComponentError
from gvla2.evaluation.suites.robot_design import designs
from gvla2.plugins.registry import load_plugins
from gvla2.robot.backend import SuccessCheck
from gvla2.robot.report import ExecutionReport
from gvla2.robot.task import TaskInstance
from gvla2.testing import inputs
from gvla2.testing.robot import check_robot
from tests.composing import bench_config
from tests.pages import plugin_of

SENTENCES = {"kitchen/0": "lift the red cube", "kitchen/1": "lift the blue cube"}


class Kitchen:
    """A world with its own scene, sentences and success check, whose arm does not move."""

    def __init__(self, config: ComponentConfig) -> None:
        self.arm, self.chosen = inputs.gantry(), None

    def tasks(self):
        return SENTENCES

    def reset(self, task, seed, instruction=None):
        self.chosen = task
        return TaskInstance(instruction or SENTENCES[task]) if task else None

    def observe(self):
        return inputs.observation()

    def execute(self, trajectory, scene, listener=None):
        return ExecutionReport(())

    def success_check(self):
        return SuccessCheck(True, True)

    def close(self):
        pass


class Plugin:
    @hookimpl
    def gvla2_robots(self):
        return [Component("kitchen", ComponentConfig, Kitchen)]


@pytest.fixture(autouse=True)
def kitchen():
    register(Plugin(), name="kitchen")
    yield
    unregister("kitchen")


def test_a_run_takes_the_robots_own_task_by_name(tmp_path: Path):
    config, registry = composed("run", ["robot=kitchen", "task=kitchen/1", "memory=none", "quiet=true"])
    (record,) = run_episodes(config, registry, tmp_path)
    assert (record.task, record.instruction) == ("kitchen/1", "lift the blue cube")
    assert record.success_check == SuccessCheck(True, True)


@pytest.mark.parametrize(
    ("robot", "task", "message"),
    [
        ("kitchen", "kitchen/2", "No task of robot 'kitchen' named 'kitchen/2'. Did you mean 'kitchen/"),
        (
            "kitchen",
            "pick_and_lift",
            "Available: kitchen/0, kitchen/1. `gvla2 tasks robot=kitchen` lists",
        ),
        (
            "sapien_panda",
            "kitchen/1",
            "No task of robot 'sapien_panda' named 'kitchen/1'. Available: none at all",
        ),
    ],
)
def test_other_tasks_are_refused(robot: str, task: str, message: str):
    config, registry = composed("run", [f"robot={robot}", f"task={task}"])
    with pytest.raises(UnknownComponentError) as raised:
        registry.build_all(config, ("robot", "task"))
    assert message in str(raised.value)


def test_the_command_lists_them(capsys: pytest.CaptureFixture[str]):
    assert worlds.tasks(["robot=kitchen"]) == 0
    listing = capsys.readouterr().out
    assert all(name in listing and sentence in listing for name, sentence in SENTENCES.items())


def test_one_that_takes_joint_targets_is_an_environment():
    pytest.importorskip("gymnasium", reason="pip install 'gvla2[gym]'")
    from gvla2.gym.env import TaskEnv

    with pytest.raises(ConfigurationError, match="Kitchen takes no joint targets"):
        TaskEnv("kitchen/0", robot="kitchen")
    with plugin_of("your_simulator.md", 0), closing(TaskEnv("toy/lift", robot="toy")) as env:
        _, info = env.reset(seed=0)
        assert info["instruction"] == "lift the red cube"


def test_the_simulator_of_the_page_lifts_its_cube_in_sixty_lines(tmp_path: Path):
    with plugin_of("your_simulator.md", 0) as text:
        assert text.count("\n") <= 60
        config, registry = composed(
            "run", ["robot=toy", "task=toy/lift", "memory=none", "quiet=true", "seed=3"]
        )
        (record,) = run_episodes(config, registry, tmp_path)
        assert record.instruction == "lift the red cube"
        assert record.success_check == SuccessCheck(True, True)
        assert list(tmp_path.rglob("*.mp4"))
        robot, _ = registry.build_all(config, ("robot", "task")).values()
        check_robot(robot)
        robot.reset("toy/lift", 0)
        assert robot.success_check().relaxed is False
        with pytest.raises(RobotError, match="driven to finite joints"):
            robot.servo(robot.arm.home * np.nan, 1.0, 0.05)
        with pytest.raises(RobotError, match=r"got shape \(3,\)"):
            robot.servo(np.zeros(3), 1.0, 0.05)
        robot._world.joints = robot.arm.home * np.nan
        with pytest.raises(SimulationError, match="blown up and cannot be observed"):
            robot.observe()


def test_a_bench_takes_the_robots_tasks_by_a_pattern(tmp_path: Path):
    registry = load_plugins()
    arms = ("arms=[off]", "layouts=[10,11]", "workers=1", "quiet=true")
    config = bench_config(
        registry, "suite=robot", "conditions=clean", "robot=kitchen", "tasks=[kitchen/*]", *arms
    )
    config.results.url = f"sqlite:///{tmp_path / 'results.sqlite'}"
    (design,) = designs(config, registry)
    assert [(unit.subject, unit.layout) for unit in design.plan] == list(product(SENTENCES, (10, 11)))
    run_bench(config, registry, tmp_path / "out")
    rows = json.loads((tmp_path / "out" / "result.json").read_text())["rows"]
    assert {row["instruction"] for row in rows} == set(SENTENCES.values())
    for wrong in ("garden/*", "kitchen/9"):
        with pytest.raises(
            ConfigurationError, match=rf"no task like '{re.escape(wrong)}.*offers: kitchen/\*"
        ):
            designs(replace(config, tasks=[wrong]), registry)
