"""Clutter: distractors for any task."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import COLOURS
from gvla2.robot.options import TaskConfig
from gvla2.robot.solids import body_points, distinct, planar, sample_root
from gvla2.robot.task import Body, Layout, Primitive, Task, TaskInstance, TaskSite

MOST = 12
GAP = 0.05
"""Metres between a distractor and everything else: room for an opening hand."""

TRIES = 4000
DROP = 0.001
"""Height above the table from which distractors settle, metres."""

MASS = 0.08


def cluttered(task: Task, config: object) -> Task:
    """The task with the distractors that its options ask for; the task itself if there are none.

    Raises :class:`ConfigurationError` for an invalid number.
    """
    if not isinstance(config, TaskConfig) or config.distractors == 0:
        return task
    if not 0 < config.distractors <= MOST:
        raise ConfigurationError(f"task.distractors is {config.distractors}; it is 0 to {MOST}.")
    return Cluttered(task, config.distractors)


class Cluttered:
    """Implements :class:`gvla2.robot.task.Task`: another task's episodes, with distractors drawn by the seed."""

    def __init__(self, task: Task, count: int) -> None:
        self.__wrapped__, self._count, self.instructions = task, count, task.instructions

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's own episode of the seed; its bodies have the same places as without clutter.

        Raises :class:`ConfigurationError` when there is not enough room.
        """
        own = rng.spawn(1)[0]  # before the task draws: its number of draws may depend on the sentence
        instance = self.__wrapped__.sample(rng, site, instruction)
        taken = _circles(instance.layout)
        added: list[Body] = []
        for number in range(self._count):
            body = _distractor(own, f"distractor_{number}", instance.layout, site)
            sides = body.solids[0].size
            radius = 0.5 * float(np.hypot(sides[0], sides[1]))
            root = _free_place(own, site, radius, taken)
            if root is None:
                raise ConfigurationError(
                    f"There is no room for {self._count} distractors beside the task's objects, only for {len(added)}. "
                    "Ask for fewer (task.distractors)."
                )
            added.append(replace(body, world_from_body=root @ body.world_from_body))
            taken = np.vstack([taken, (*root[:2, 3], radius)])
        return replace(instance, layout=replace(instance.layout, bodies=(*instance.layout.bodies, *added)))


def _distractor(rng: np.random.Generator, name: str, layout: Layout, site: TaskSite) -> Body:
    """A body above the world's origin, at the height of the table.

    Its colour is unlike the task's colours, if any are left, and the table's; its shape is one that no simple object
    of the task has, so that "the block" stays unique.
    """
    shown = [solid.rgb for body in layout.bodies for solid in body.solids]
    shown += [site.table_rgb] if site.table_rgb is not None else []
    names = [n for n, rgb in COLOURS.items() if distinct(rgb, shown)] or list(COLOURS)
    colour = names[int(rng.integers(len(names), size=1)[0])]
    turn = float(rng.uniform(-np.pi, np.pi))
    simple = [b for b in layout.bodies if len(b.solids) == 1 and not b.fixed]
    own = {b.solids[0].kind for b in simple if b.solids[0].collides}
    kinds = [kind for kind in ("cylinder", "box") if kind not in own] or ["cylinder", "box"]
    kind = kinds[int(rng.integers(len(kinds)))]
    broad, deep, tall = rng.uniform((0.03, 0.03, 0.04), (0.06, 0.06, 0.12)).tolist()
    sides = (broad, broad if kind == "cylinder" else deep, tall)
    solid = Primitive("cylinder" if kind == "cylinder" else "box", sides, COLOURS[colour])
    pose = planar((0.0, 0.0), site.table_height + DROP + 0.5 * tall, turn)
    return Body(name, (solid,), pose, MASS, label=f"{colour} {kind}")


def _circles(layout: Layout) -> FloatArray:
    """Circles (N, 3) that the task's bodies occupy, their joints' travel included: x, y and radius, metres."""
    circles = []
    for body in layout.bodies:
        points = body_points(body, body.world_from_body)
        circles.append(_circle(points, 0.5 * (points.min(axis=0) + points.max(axis=0))))
    for joint in layout.joints:
        points = body_points(layout[joint.child], layout[joint.child].world_from_body)
        if joint.kind == "prismatic":
            points = np.concatenate([points + travel * np.asarray(joint.axis) for travel in joint.limits])
            circles.append(_circle(points, 0.5 * (points.min(axis=0) + points.max(axis=0))))
        else:
            away = np.linalg.norm(points - joint.origin, axis=1).max()
            circles.append((*joint.origin[:2], away))
    return np.array(circles, dtype=np.float64).reshape(-1, 3)


def _circle(points: FloatArray, middle: FloatArray) -> tuple[float, ...]:
    return (*middle[:2], np.linalg.norm((points - middle)[:, :2], axis=1).max())


def _free_place(
    rng: np.random.Generator, site: TaskSite, radius: float, taken: FloatArray
) -> FloatArray | None:
    """A place (4, 4) on the table, turned at random, clear of the circles ``taken``; None when there is none."""
    for _ in range(TRIES):
        root = sample_root(rng, site)
        root[2, 3] = 0.0
        off = np.linalg.norm(taken[:, :2] - root[:2, 3], axis=1) - taken[:, 2] - radius
        if (off > GAP).all():
            return root
    return None
