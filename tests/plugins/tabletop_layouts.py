"""Tabletop tasks built and laid out by name, on the table of the simulated Panda; bodies that ask for nothing."""

from typing import Any

import numpy as np

from gvla2.robot.task import Body, Layout, Task, TaskInstance, TaskSite
from gvla2_plugins.tabletop import gvla2_tasks

TABLE = 0.752
TABLE_RGB = (0.76, 0.61, 0.43)
TASKS = {component.name: component for component in gvla2_tasks()}


def near_the_base(point: np.ndarray) -> bool:
    return bool(np.linalg.norm(point[:2] - (-0.268, 0.0)) < 0.75)


def site(**changes: Any) -> TaskSite:
    what = {"centre": (0.25, 0.0), "size": (0.65, 0.91), "table_height": TABLE, "reachable": near_the_base}
    return TaskSite(**{**what, "table_rgb": TABLE_RGB, **changes})


def task(name: str, **options: Any) -> Task:
    return TASKS[name].build(TASKS[name].config(**options))


def sample(name: str, seed: int, instruction: str | None = None, **options: Any) -> TaskInstance:
    return task(name, **options).sample(np.random.default_rng(seed), site(), instruction)


class Laid:
    """A task of these bodies, whose goal is never reached."""

    instructions = ("-",) * 4

    def __init__(self, *bodies: Body, **more: Any) -> None:
        self.layout = Layout(bodies, **more)

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        return TaskInstance("-", self.layout, {p: lambda world: False for p in ("relaxed", "strict")})
