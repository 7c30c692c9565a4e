"""Some tasks solved by their demonstrations; ``tests/benchmarks/demonstrations.py`` solves all, over seeds."""

import pytest

from gvla2.errors import ConfigurationError
from gvla2.robot.backend import demonstrate
from gvla2.robot.task import TaskInstance
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots
from tests.plugins.tabletop_layouts import TASKS, task


@pytest.fixture(scope="module")
def panda():
    robot = gvla2_robots()[0].build(SapienPandaConfig(image_size=64))
    yield robot
    robot.close()


def laid(panda, name: str, seed: int, **options) -> TaskInstance:
    return panda.reset(task(name, **options), seed)


@pytest.mark.parametrize(
    ("name", "seed", "scale"),
    [
        ("take_umbrella", 1, 1.0), ("close_box", 6, 1.0), ("open_wine", 3, 1.0), ("pickup_cup", 1, 1.0),
        ("open_drawer", 1, 0.8),
    ],
)  # fmt: skip
def test_it_can_be_done(panda, name, seed, scale):
    instance = laid(panda, name, seed, scale=scale)
    before = panda.success_check()
    assert (before.relaxed, before.strict) == (False, False)
    reports = demonstrate(panda, instance)
    assert all(report.completed for report in reports), reports[-1].abort
    after = panda.success_check()
    assert (after.relaxed, after.strict) == (True, True)


def test_every_task_has_a_demonstration(panda):
    for name in TASKS:
        assert laid(panda, name, 0).solution is not None, name


def test_without_solution_or_truth_there_is_no_demonstration(panda):
    instance = laid(panda, "take_umbrella", 1)
    with pytest.raises(ConfigurationError, match="does not expose the true state"):
        demonstrate(object(), instance)
    bare = TaskInstance("-", instance.layout, instance.succeeded)
    with pytest.raises(ConfigurationError, match="without a demonstration"):
        demonstrate(panda, bare)
