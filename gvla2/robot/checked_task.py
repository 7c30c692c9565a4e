"""A task of a plugin, untrusted: its episodes and its success checks are checked, and their faults name it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gvla2.errors import ConformanceError, PluginError
from gvla2.geometry.requirements import require, require_rigid, require_type
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Layout, Primitive, Profile, Task, TaskInstance, TaskSite, WorldState

PROFILES = ("relaxed", "strict")
SHAPES = ("box", "cylinder", "sphere", "mesh")


class CheckedTask:
    """Implements :class:`gvla2.robot.task.Task` by another; ``who`` begins the sentences about that one."""

    def __init__(self, task: Task, who: str) -> None:
        self.__wrapped__, self._who = task, who

    @property
    def instructions(self) -> tuple[str, ...]:
        """The task's own."""
        return self.__wrapped__.instructions

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's episode; raises :class:`PluginError` for one that cannot be laid out.

        So do its success checks, for an answer other than True or False and for a thing that the layout lacks.
        """
        instance = self.__wrapped__.sample(rng, site, instruction)
        try:
            check_instance(instance)
            require(instruction is not None or instance.instruction.strip(), "Its instruction is empty.")
        except ConformanceError as error:
            raise PluginError(f"{self._who} gave no valid episode. {error}") from error
        checked: dict[Profile, Callable[[WorldState], bool]] = {
            profile: self._checked(profile, instance) for profile in instance.succeeded
        }
        return replace(instance, succeeded=checked)

    def _checked(self, profile: Profile, instance: TaskInstance) -> Callable[[WorldState], bool]:
        who = f"{self._who}: its success check '{profile}'"

        def checked(state: WorldState) -> bool:
            answer: object = instance.succeeded[profile](_Named(state, instance.layout, who))
            if not isinstance(answer, bool | np.bool_):
                raise PluginError(f"{who} answered {answer!r:.80}; it must be True or False.")
            return bool(answer)

        return checked


class _Named:
    """A :class:`gvla2.robot.task.WorldState` that is asked only about what is there."""

    def __init__(self, state: WorldState, layout: Layout, who: str) -> None:
        bodies = {body.name for body in layout.bodies}
        threads = {thread.name for thread in layout.threads}
        moving = threads | {joint.name for joint in layout.joints}
        self._known = dict.fromkeys(("pose", "held", "touching", "resting"), ("body", bodies))
        self._known |= {"joint": ("joint", moving), "peak": ("joint", moving), "loose": ("thread", threads)}
        self._state, self._who = state, who

    def __getattr__(self, question: str) -> Any:
        ask = getattr(self._state, question)
        if question not in self._known:
            return ask
        kind, names = self._known[question]

        def asked(name: str) -> Any:
            if name not in names:
                has = f"it has {', '.join(sorted(names))}" if names else "it has none"
                raise PluginError(f"{self._who} asks for the {kind} '{name}', which its layout lacks; {has}.")
            return ask(name)

        return asked


def check_instance(instance: object) -> None:
    """Whether an episode can be laid out, asked and checked; raises :class:`ConformanceError` with what is wrong."""
    require_type(instance, TaskInstance, "sample()'s answer")
    assert isinstance(instance, TaskInstance)
    require_type(instance.layout, Layout, "The layout")
    require_type(instance.instruction, str, "The instruction")
    names = [body.name for body in instance.layout.bodies]
    require(names and all(names) and len(set(names)) == len(names), f"Bodies need unique names, got {names}.")
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
        set(instance.succeeded) == set(PROFILES) and all(map(callable, instance.succeeded.values())),
        f"A task has the success profiles 'relaxed' and 'strict', each a function, got {instance.succeeded!r:.200}.",
    )


def _check_body(body: Body) -> None:
    what = f"Body '{body.name}'"
    require_rigid(body.world_from_body, f"{what}: world_from_body")
    require(body.solids, f"{what} has no solids.")
    require(body.fixed or body.mass > 0, f"{what} can move, so its mass must be positive.")
    for solid in body.solids:
        require_type(solid, (Primitive, Scan), f"{what}: a solid")
        require(
            solid.kind in SHAPES,
            f"{what}: a solid is a '{solid.kind}'; there are box, cylinder, sphere and Scan.",
        )
        size = solid.size
        require(
            len(size) == 3 and min(size) > 0 and np.isfinite(size).all(), f"{what}: a solid of size {size}."
        )
        require(all(0 <= c <= 1 for c in solid.rgb), f"{what}: the colour {solid.rgb} leaves [0, 1].")
        require_rigid(solid.body_from_shape, f"{what}: body_from_shape")
