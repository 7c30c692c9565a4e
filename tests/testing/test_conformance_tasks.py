"""The conformance check of tasks passes a good one and catches what is bad."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gvla2.robot.task import Body, Joint, Layout, Primitive, TaskInstance
from gvla2.testing import CHECKS, ConformanceError


def a_body(rng: np.random.Generator, height: float, name: str = "cube") -> Body:
    pose = np.eye(4)
    pose[:3, 3] = [*rng.uniform(-0.1, 0.1, 2), height + 0.025]
    return Body(name, (Primitive("box", (0.05, 0.05, 0.05), (1, 0, 0)),), pose)


def a_task(
    change: Callable[[TaskInstance], TaskInstance] = lambda i: i, repeatable: bool = True
) -> SimpleNamespace:
    noise = np.random.default_rng(0)

    def sample(rng: np.random.Generator, site: Any, instruction: str | None = None) -> TaskInstance:
        layout = Layout((a_body(rng if repeatable else noise, site.table_height),))
        done = {p: lambda state: state.held("cube") for p in ("relaxed", "strict")}
        made = TaskInstance(layout, "lift the cube", done)
        return replace(change(made), **({"instruction": instruction} if instruction else {}))

    return SimpleNamespace(instructions=("a", "b", "c", "d"), sample=sample)


def with_body(**changes: Any) -> Callable[[TaskInstance], TaskInstance]:
    return lambda i: replace(i, layout=Layout((replace(i.layout.bodies[0], **changes),)))


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (SimpleNamespace(instructions=("a", "a", "a", "a"), sample=lambda *a: None), "four paraphrases"),
        (a_task(repeatable=False), "same layout each time"),
        (a_task(with_body(world_from_body=np.eye(4))), "into the table"),
        (a_task(with_body(mass=0.0)), "mass must be positive"),
        (a_task(with_body(solids=())), "has no solids"),
        (a_task(lambda i: replace(i, instruction="lift the {colour} cube")), "finished sentence"),
        (
            a_task(lambda i: replace(i, succeeded={"relaxed": lambda s: False})),
            "profiles 'relaxed' and 'strict'",
        ),
        (
            a_task(lambda i: replace(i, succeeded=dict.fromkeys(("relaxed", "strict"), lambda s: True))),
            "already done",
        ),
        (a_task(lambda i: replace(i, layout=Layout(i.layout.bodies * 2))), "unique names"),
        (
            a_task(
                lambda i: replace(
                    i,
                    layout=Layout(
                        i.layout.bodies,
                        (
                            Joint(
                                "j", "prismatic", "cube", "ghost", np.array([0, 0, 1.0]), np.zeros(3), (0, 1)
                            ),
                        ),
                    ),
                )
            ),
            "not there",
        ),
    ],
)
def test_bad_tasks_are_caught(task: SimpleNamespace, message: str):
    CHECKS["task"](a_task())
    with pytest.raises(ConformanceError, match=message):
        CHECKS["task"](task)


def test_a_task_that_ignores_its_seed_is_caught():
    with pytest.raises(ConformanceError, match="all give the same layout"):
        CHECKS["task"](
            a_task(with_body(world_from_body=a_body(np.random.default_rng(1), 0.752).world_from_body))
        )
