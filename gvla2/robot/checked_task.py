"""A task of a plugin, untrusted: its episodes and its success checks are checked, and their faults name it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gvla2.errors import ConformanceError, PluginError
from gvla2.geometry.exchange import require, require_rigid, require_type
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Joint, Layout, Primitive, Task, TaskInstance, TaskSite, Thread, WorldState


class CheckedTask:
    """Implements :class:`gvla2.robot.task.Task` by another; ``who`` begins the sentences about that one."""

    def __init__(self, task: Task, who: str) -> None:
        self.__wrapped__, self._who, self.instructions = task, who, task.instructions

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's episode; raises :class:`PluginError` for one that cannot be laid out.

        So do its success checks, for an answer other than True or False and for an object that the layout lacks.
        """
        made = self.__wrapped__.sample(rng, site, instruction)
        try:
            check_instance(made)
            require(instruction is not None or made.instruction.strip(), "Its instruction is empty.")
        except ConformanceError as error:
            raise PluginError(f"{self._who} gave no valid episode. {error}") from error
        parts: list[Body | Joint | Thread] = [*made.layout.bodies, *made.layout.joints, *made.layout.threads]
        names = [part.name for part in parts]
        checks = {name: partial(self._answer, name, check, names) for name, check in made.succeeded.items()}
        return replace(made, succeeded=checks)

    def _answer(
        self, profile: str, check: Callable[[Any], object], names: Collection[str], state: WorldState
    ) -> bool:
        who = f"{self._who}: its success check '{profile}'"
        answer = check(_Named(state, names, who))
        if not isinstance(answer, bool | np.bool_):
            raise PluginError(f"{who} answered {answer!r:.80}; it must be True or False.")
        return bool(answer)


class _Named:
    """A :class:`gvla2.robot.task.WorldState` that is asked only about objects of these names."""

    def __init__(self, state: WorldState, names: Collection[str], who: str) -> None:
        self._state, self._names, self._who = state, names, who

    def __getattr__(self, question: str) -> Callable[[str], Any]:
        def asked(name: str) -> Any:
            if name not in self._names:
                has = ", ".join(self._names)
                raise PluginError(f"{self._who} asks for '{name}', which its layout lacks; it has {has}.")
            return getattr(self._state, question)(name)

        return asked


def check_instance(instance: object) -> None:
    """Whether an episode can be laid out, asked and checked; raises :class:`ConformanceError` with what is wrong."""
    require_type(instance, TaskInstance, "sample()'s answer")
    assert isinstance(instance, TaskInstance)
    require_type(instance.layout, Layout, "The layout")
    require_type(instance.instruction, str, "The instruction")
    names = [body.name for body in instance.layout.bodies]
    require(all(names) and len(set(names)) == len(names), f"Bodies need unique names, got {names}.")
    for body in instance.layout.bodies:
        _check_body(body)
    for joint in instance.layout.joints:
        require(
            {joint.parent, joint.child} <= set(names),
            f"Joint '{joint.name}' joins bodies that are not there: '{joint.parent}', '{joint.child}'.",
        )
        require(
            joint.limits[0] < joint.limits[1],
            f"Joint '{joint.name}': its limits {joint.limits} are not a range.",
        )
        length = float(np.linalg.norm(joint.axis))
        require(abs(length - 1) < 1e-6, f"Joint '{joint.name}': its axis has length {length:.4f}, not 1.")
    require(
        set(instance.succeeded) <= {"relaxed", "strict"} and all(map(callable, instance.succeeded.values())),
        f"The success profiles are 'relaxed' and 'strict', each a function, got {instance.succeeded!r:.200}.",
    )


def _check_body(body: Body) -> None:
    what = f"Body '{body.name}'"
    require_rigid(body.world_from_body, f"{what}: world_from_body")
    require(body.solids, f"{what} has no solids.")
    require(body.fixed or body.mass > 0, f"{what} can move, so its mass must be positive.")
    for solid in body.solids:
        require_type(solid, (Primitive, Scan), f"{what}: a solid")
        known = solid.kind in ("box", "cylinder", "sphere", "mesh")
        require(known, f"{what}: a solid is a '{solid.kind}'; there are box, cylinder, sphere and Scan.")
        size = solid.size
        require(
            len(size) == 3 and min(size) > 0 and np.isfinite(size).all(), f"{what}: a solid of size {size}."
        )
        require(all(0 <= c <= 1 for c in solid.rgb), f"{what}: the colour {solid.rgb} leaves [0, 1].")
        require_rigid(solid.body_from_shape, f"{what}: body_from_shape")
