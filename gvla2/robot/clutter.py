"""Clutter: distractors for any task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS
from gvla2.robot.options import TaskConfig
from gvla2.robot.placing import distinct, planar, sample_root
from gvla2.robot.solids import body_points
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
    return Cluttered(task, config)


class Cluttered:
    """Implements :class:`gvla2.robot.task.Task`: another task's episodes, with distractors drawn by the seed."""

    def __init__(self, task: Task, config: TaskConfig) -> None:
        if not 0 <= config.distractors <= MOST:
            raise ConfigurationError(f"task.distractors is {config.distractors}; it is 0 to {MOST}.")
        self.__wrapped__, self._config, self.instructions = task, config, task.instructions

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
        for number in range(self._config.distractors):
            body = self._distractor(own, f"distractor_{number}", instance, site)
            _, _, radius = _circle(body_points(body, body.world_from_body))
            root = _free_place(own, site, radius, taken)
            if root is None:
                raise ConfigurationError(
                    f"There is no room for {self._config.distractors} distractors beside the task's objects, only for "
                    f"{len(added)}. Ask for fewer (task.distractors)."
                )
            added.append(replace(body, world_from_body=root @ body.world_from_body))
            taken.append((float(root[0, 3]), float(root[1, 3]), radius))
        return replace(instance, layout=replace(instance.layout, bodies=(*instance.layout.bodies, *added)))

    def _distractor(
        self, rng: np.random.Generator, name: str, instance: TaskInstance, site: TaskSite
    ) -> Body:
        """A body above the world's origin, at the height of the table."""
        colour = _colour(rng, instance.layout, site)
        turn = float(rng.uniform(-np.pi, np.pi))
        kinds = _kinds(instance.layout)
        kind = kinds[int(rng.integers(len(kinds)))]
        broad, deep, tall = rng.uniform((0.03, 0.03, 0.04), (0.06, 0.06, 0.12)).tolist()
        sides = (broad, broad if kind == "cylinder" else deep, tall)
        solid = Primitive("cylinder" if kind == "cylinder" else "box", sides, COLOURS[colour])
        body = Body(name, (solid,), planar((0.0, 0.0), 0.0, turn), MASS, label=f"{colour} {kind}")
        return _on_table(body, site)


def _kinds(layout: Layout) -> list[str]:
    """Shapes that no simple object of the task has, so that "the block" stays unique."""
    simple = [b for b in layout.bodies if len(b.solids) == 1 and not b.fixed]
    own = {b.solids[0].kind for b in simple if b.solids[0].collides}
    return [kind for kind in ("cylinder", "box") if kind not in own] or ["cylinder", "box"]


def _colour(rng: np.random.Generator, layout: Layout, site: TaskSite) -> str:
    """A colour word distinct from the task's colours, if any are left, and from the table."""
    shown = [solid.rgb for body in layout.bodies for solid in body.solids]
    shown += [site.table_rgb] if site.table_rgb is not None else []
    names = [n for n, rgb in COLOURS.items() if distinct(rgb, shown)] or list(COLOURS)
    return names[int(rng.integers(len(names), size=1)[0])]


def _on_table(body: Body, site: TaskSite) -> Body:
    points = body_points(body, body.world_from_body)
    x, y, _ = 0.5 * (points.min(axis=0) + points.max(axis=0))
    shift = rigid(translation=(-x, -y, site.table_height + DROP - points[:, 2].min()))
    return replace(body, world_from_body=shift @ body.world_from_body)


Circle = tuple[float, float, float]
"""x, y and radius on the table, metres."""


def _circle(points: FloatArray, middle: FloatArray | None = None) -> Circle:
    """The circle about the ``middle`` (3,) of world points (N, 3) that holds them, seen from above."""
    if middle is None:
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return float(middle[0]), float(middle[1]), float(np.linalg.norm((points - middle)[:, :2], axis=1).max())


def _circles(layout: Layout) -> list[Circle]:
    """Circles that the task's bodies occupy, including their joints' travel."""
    circles = [_circle(body_points(body, body.world_from_body)) for body in layout.bodies]
    for joint in layout.joints:
        points = body_points(layout[joint.child], layout[joint.child].world_from_body)
        if joint.kind == "prismatic":
            ends = [points + travel * np.asarray(joint.axis) for travel in joint.limits]
            circles.append(_circle(np.concatenate(ends)))
        else:
            away = np.linalg.norm(points - joint.origin, axis=1).max()
            circles.append((float(joint.origin[0]), float(joint.origin[1]), float(away)))
    return circles


def _free_place(
    rng: np.random.Generator, site: TaskSite, radius: float, taken: Sequence[Circle]
) -> FloatArray | None:
    """A place (4, 4) on the table, turned at random, clear of the circles ``taken``; None when there is none."""
    circles = np.array(taken).reshape(-1, 3)
    for _ in range(TRIES):
        root = sample_root(rng, site)
        root[2, 3] = 0.0
        off = np.linalg.norm(circles[:, :2] - root[:2, 3], axis=1) - circles[:, 2] - radius
        if (off > GAP).all():
            return root
    return None
