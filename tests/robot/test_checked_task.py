"""Episodes and success checks of a plugin's task: what is wrong with them is said of the task."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import PluginError
from gvla2.geometry.transform import rigid
from gvla2.robot.backend import SuccessCheck, judge
from gvla2.robot.task import Body, CheckedTask, Joint, Layout, Primitive, TaskInstance, Thread
from gvla2.testing.robot import SITE, _AtRest

WHO = "The task 'mine' of plugin 'yours'"
BLOCK = Body("block", (Primitive("box", (0.05,) * 3, (0.8, 0.2, 0.1)),), rigid(translation=(0.25, 0.0, 0.8)))
GOOD = TaskInstance(
    "raise the block", Layout((BLOCK,)), {"relaxed": lambda w: False, "strict": lambda w: np.bool_(True)}
)


class Task:
    instructions = ("raise the block",) * 4

    def __init__(self, instance):
        self.instance = instance

    def sample(self, rng, site, instruction=None):
        return self.instance


def sample(instance, instruction=None):
    return CheckedTask(Task(instance), WHO).sample(np.random.default_rng(0), SITE, instruction)


def with_body(**fields):
    return replace(GOOD, layout=Layout((replace(BLOCK, **fields),)))


def with_solid(**fields):
    return with_body(solids=(replace(BLOCK.solids[0], **fields),))


LID = replace(BLOCK, name="lid")
THREAD = Thread("thread", "block", "lid", np.array([0.0, 0.0, 1.0]), np.zeros(3), 6.5, (0.0, 7.0))
HINGE = Joint("hinge", "revolute", "block", "lid", np.array([0.0, 0.0, 1.0]), np.zeros(3), (0.0, 1.0))


@pytest.mark.parametrize(
    ("instance", "expected"),
    [
        (None, "must be TaskInstance, got NoneType"),
        (replace(GOOD, instruction=" "), "Its instruction is empty"),
        (replace(GOOD, succeeded={"loose": bool}), "'relaxed' and 'strict'"),
        (replace(GOOD, succeeded={"relaxed": True, "strict": True}), "each a function"),
        (replace(GOOD, layout=Layout((BLOCK, BLOCK))), "unique names"),
        (replace(GOOD, layout=Layout((BLOCK,), (HINGE,))), "'hinge' ties 'block' to 'lid'"),
        (replace(GOOD, layout=Layout((BLOCK, LID), (HINGE, HINGE))), "two joints"),
        (replace(GOOD, layout=Layout((BLOCK, LID), (HINGE,), threads=(THREAD,))), "two joints"),
        (with_body(name=""), "unique names"),
        (with_body(world_from_body=rigid(translation=(np.nan, 0, 1))), "Body 'block': world_from_body"),
        (with_body(solids=()), "'block' has no solids"),
        (with_body(solids=("box",)), "must be Primitive or Scan, got str"),
        (with_solid(kind="torus"), "a solid is a 'torus'; there are box, cylinder, sphere"),
        (with_solid(size=(0.0, 0.0, 0.0)), "a solid of size"),
        (with_solid(size=(-0.05,) * 3), "a solid of size"),
        (with_solid(rgb=(255, 0, 0)), "leaves .0, 1."),
    ],
)
def test_what_cannot_be_laid_out_is_reported_for_the_task(instance, expected):
    with pytest.raises(PluginError, match=f"{WHO} gave no valid episode. .*{expected}"):
        sample(instance)


def test_success_checks_answer_yes_or_no():
    assert judge(GOOD, _AtRest(GOOD.layout)) == SuccessCheck(relaxed=False, strict=True)
    assert judge(replace(GOOD, succeeded={"strict": lambda w: True}), None) == SuccessCheck(True, True)
    assert judge(replace(GOOD, succeeded={}), None) is None
    with pytest.raises(PluginError, match="'strict' answered 'no'; it must be True or False"):
        judge(replace(GOOD, succeeded={"strict": lambda w: "no"}), None)


def test_every_task_of_the_catalog_is_checked(registry):
    task = registry.build({"task": "pick_and_lift"}, "task")
    assert isinstance(task, CheckedTask)
    task.__wrapped__ = Task(None)
    with pytest.raises(PluginError, match="The task 'pick_and_lift' of plugin 'tabletop' gave no valid"):
        task.sample(np.random.default_rng(0), SITE)
