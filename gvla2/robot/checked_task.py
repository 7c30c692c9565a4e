"""Checks of an episode that a plugin's task sampled; faults name the plugin."""

from __future__ import annotations

import numpy as np

from gvla2.errors import ConformanceError, PluginError
from gvla2.geometry.exchange import require, require_rigid, require_type
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Layout, Primitive, Task, TaskInstance, TaskSite


class CheckedTask:
    """Implements :class:`gvla2.robot.task.Task` by another; ``who`` begins the sentences about that one."""

    def __init__(self, task: Task, who: str) -> None:
        self.__wrapped__, self._who, self.instructions = task, who, task.instructions

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's episode; raises :class:`PluginError` for one that cannot be laid out."""
        made = self.__wrapped__.sample(rng, site, instruction)
        try:
            check_instance(made)
            require(instruction is not None or made.instruction.strip(), "Its instruction is empty.")
        except ConformanceError as error:
            raise PluginError(f"{self._who} gave no valid episode. {error}") from error
        return made


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
    _check_joints(instance.layout, names)
    require(
        set(instance.succeeded) <= {"relaxed", "strict"} and all(map(callable, instance.succeeded.values())),
        f"The success profiles are 'relaxed' and 'strict', each a function, got {instance.succeeded!r:.200}.",
    )


def _check_joints(layout: Layout, names: list[str]) -> None:
    ties = [*layout.joints, *layout.threads]
    for tie in ties:
        require(
            {tie.parent, tie.child} <= set(names),
            f"'{tie.name}' ties '{tie.parent}' to '{tie.child}'; the bodies are {sorted(names)}.",
        )
        require(tie.limits[0] < tie.limits[1], f"'{tie.name}': its limits {tie.limits} are not a range.")
        length = float(np.linalg.norm(tie.axis))
        require(abs(length - 1) < 1e-6, f"'{tie.name}': its axis has length {length:.4f}, not 1.")
    children = [tie.child for tie in ties]
    require(len(set(children)) == len(children), f"A body hangs on two joints: {sorted(children)}.")
    parents = {tie.child: tie.parent for tie in ties}
    for child in children:
        above = parents[child]
        while above in parents and above != child:
            above = parents[above]
        require(above != child, f"The joints form a ring through '{child}'.")
    for thread in layout.threads:
        require(
            not layout[thread.child].fixed and 0 < thread.release < 2 * np.pi,
            f"Thread '{thread.name}' needs a child that is not fixed and a release in (0, 2 pi), got {thread.release}.",
        )
    joints = {joint.name for joint in layout.joints}
    for catch in layout.catches:
        require(
            {catch.joint, catch.key} <= joints and catch.joint != catch.key,
            f"A catch holds '{catch.joint}' until '{catch.key}' has moved; the joints are {sorted(joints)}.",
        )
    for body in layout.bodies:
        require(
            (body.fixed and body.name not in parents) or any(solid.collides for solid in body.solids),
            f"Body '{body.name}' can move, but nothing of it is solid.",
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
