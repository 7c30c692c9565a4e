"""Clutter: distractors for any task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.planning.colours import COLOURS, DISTINCT, colour_distance
from gvla2.robot.options import TaskConfig
from gvla2.robot.placing import planar, sample_root
from gvla2.robot.scan import Mesh, mesh_library, spoken
from gvla2.robot.solids import body_points
from gvla2.robot.task import Body, Layout, Primitive, Task, TaskInstance, TaskSite

ARRANGEMENTS = ("apart", "touching", "leaning", "stack", "mixed")
MOST = 12
GAP = 0.05
"""Metres between a group of distractors and everything else: room for an opening hand."""

TRIES = 4000
TOGETHER, DROP = 0.0005, 0.001
"""Metres between objects that touch, and the height above the table from which they settle."""

BOARD = (0.012, 0.07, 0.13)
LEAN = 0.4
"""A leaning board's sides, metres, and its angle from upright, radians."""

MASS = 0.08


def cluttered(task: Task, config: object) -> Task:
    """The task with the distractors that its options ask for; the task itself if there are none.

    Raises :class:`ConfigurationError` for an invalid number or arrangement, and a folder without meshes.
    """
    if not isinstance(config, TaskConfig) or config.distractors == 0:
        return task
    return Cluttered(task, config)


class Cluttered:
    """Implements :class:`gvla2.robot.task.Task`: another task's episodes, with distractors drawn by the seed."""

    def __init__(self, task: Task, config: TaskConfig) -> None:
        if not 0 <= config.distractors <= MOST:
            raise ConfigurationError(f"task.distractors is {config.distractors}; it is 0 to {MOST}.")
        if config.arrangement not in ARRANGEMENTS:
            raise ConfigurationError(
                f"task.arrangement is '{config.arrangement}'; it is one of {', '.join(ARRANGEMENTS)}."
            )
        self.__wrapped__, self._config, self.instructions = task, config, task.instructions
        self._library = mesh_library(config.distractors_root) if config.distractors_root else {}

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's own episode of the seed; its bodies have the same places as without clutter.

        Raises :class:`ConfigurationError` when there is not enough room.
        """
        own = rng.spawn(1)[0]  # before the task draws: its number of draws may depend on the sentence
        instance = self.__wrapped__.sample(rng, site, instruction)
        taken = [*_circles(instance.layout), *instance.keep_clear]
        added: list[Body] = []
        for size, arrangement in self._groups(own):
            group = self._group(own, size, arrangement, instance, site, len(added))
            x, y, radius = _circle(np.concatenate([body_points(b, b.world_from_body) for b in group]))
            root = _free_place(own, site, radius, taken)
            if root is None:
                raise ConfigurationError(
                    f"There is no room for {self._config.distractors} distractors: after {len(added)} of them no spot "
                    f"{200 * radius:.0f} cm wide is free beside the task's objects. Ask for fewer (task.distractors)."
                )
            move = root @ rigid(translation=(-x, -y, 0.0))
            added += [replace(body, world_from_body=move @ body.world_from_body) for body in group]
            taken.append((float(root[0, 3]), float(root[1, 3]), radius))
        layout: Layout = replace(instance.layout, bodies=(*instance.layout.bodies, *added))
        return replace(instance, layout=layout)

    def _groups(self, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Sizes and arrangements of groups, up to the requested number."""
        left, groups = self._config.distractors, []
        sizes = {"apart": 1, "touching": 2, "leaning": 2, "stack": 3}
        kinds = list(sizes) if self._config.arrangement == "mixed" else [self._config.arrangement]
        while left:
            kind = kinds[int(rng.integers(len(kinds)))]
            kind = kind if sizes[kind] <= left else "apart"
            groups.append((sizes[kind], kind))
            left -= sizes[kind]
        return groups

    def _group(
        self,
        rng: np.random.Generator,
        size: int,
        arrangement: str,
        instance: TaskInstance,
        site: TaskSite,
        first: int,
    ) -> list[Body]:
        """Bodies around the world's origin, at the height of the table."""
        names = [f"distractor_{first + k}" for k in range(size)]
        colours = _colours(rng, size, instance.layout, site)
        if arrangement == "stack":
            return _stack(rng, names, colours, site)
        if arrangement == "leaning":
            return _leaning(names, colours, site)
        bodies = [self._thing(rng, *named, instance, site) for named in zip(names, colours, strict=True)]
        if arrangement == "touching":
            bodies[1] = _against(bodies[1], bodies[0], np.array([1.0, 0.0]))
        return bodies

    def _thing(
        self, rng: np.random.Generator, name: str, colour: str, instance: TaskInstance, site: TaskSite
    ) -> Body:
        turn = float(rng.uniform(-np.pi, np.pi))
        if self._library:
            chosen = list(self._library)[int(rng.integers(len(self._library)))]
            mesh = Mesh(self._library[chosen], mass=MASS)
            return _on_table(mesh.body(name, planar((0.0, 0.0), 0.0, turn), label=spoken(chosen)), site)
        kinds = _kinds(instance.layout)
        kind = kinds[int(rng.integers(len(kinds)))]
        broad, deep, tall = rng.uniform((0.03, 0.03, 0.04), (0.06, 0.06, 0.12)).tolist()
        sides = (broad, broad if kind == "cylinder" else deep, tall)
        solid = Primitive("cylinder" if kind == "cylinder" else "box", sides, COLOURS[colour])
        body = Body(name, (solid,), planar((0.0, 0.0), 0.0, turn), MASS, label=f"{colour} {kind}")
        return _on_table(body, site)


def _kinds(layout: Layout) -> list[str]:
    """Shapes that no simple object of the task has, so that "the block" stays unique."""
    own = {
        b.solids[0].kind for b in layout.bodies if len(b.solids) == 1 and not b.fixed and b.solids[0].collides
    }
    return [kind for kind in ("cylinder", "box") if kind not in own] or ["cylinder", "box"]


def _colours(rng: np.random.Generator, count: int, layout: Layout, site: TaskSite) -> list[str]:
    """Colour words distinct from the task's colours, if any are left, and from the table."""
    shown = [solid.rgb for body in layout.bodies for solid in body.solids]
    shown += [site.table_rgb] if site.table_rgb is not None else []
    free = [
        name
        for name, rgb in COLOURS.items()
        if not shown or (colour_distance(np.array(shown), rgb) >= DISTINCT).all()
    ]
    names = free or list(COLOURS)
    return [names[int(i)] for i in rng.integers(len(names), size=count)]


def _stack(
    rng: np.random.Generator, names: Sequence[str], colours: Sequence[str], site: TaskSite
) -> list[Body]:
    height, bodies = site.table_height + DROP, []
    for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
        side, thick = 0.075 - 0.015 * k, float(rng.uniform(0.02, 0.035))
        solid = Primitive("box", (side, side, thick), COLOURS[colour])
        pose = planar((0.0, 0.0), height + 0.5 * thick, float(rng.uniform(-0.3, 0.3)))
        bodies.append(Body(name, (solid,), pose, MASS, label=f"{colour} block"))
        height += thick + TOGETHER
    return bodies


def _leaning(names: Sequence[str], colours: Sequence[str], site: TaskSite) -> list[Body]:
    """A block with a board against it: the board's lower edge stands on the table, its face on the block's edge."""
    side, tall = 0.06, 0.08
    block = Body(
        names[0],
        (Primitive("box", (side, side, tall), COLOURS[colours[0]]),),
        planar((0.0, 0.0), site.table_height + DROP + 0.5 * tall, 0.0),
        3 * MASS,
        label=f"{colours[0]} block",
    )
    turn = Rotation.from_euler("y", -LEAN).as_matrix()
    board = Body(
        names[1],
        (Primitive("box", BOARD, COLOURS[colours[1]]),),
        rigid(turn),
        MASS,
        label=f"{colours[1]} board",
    )
    board = _on_table(board, site)
    # The face towards the block (-x of the board) meets the block's upper edge.
    face = transform_points(board.world_from_body, np.array([[-0.5 * BOARD[0], 0.0, 0.0]]))[0]
    normal = turn @ np.array([1.0, 0.0, 0.0])
    edge = np.array([0.5 * side, 0.0, site.table_height + DROP + tall])
    shift = float((edge - face) @ normal) / float(normal[0]) + TOGETHER
    return [
        block,
        replace(board, world_from_body=rigid(translation=(shift, 0.0, 0.0)) @ board.world_from_body),
    ]


def _against(body: Body, other: Body, way: FloatArray) -> Body:
    """The body beside the other along ``way`` (2,), their outlines touching."""
    ahead = body_points(other, other.world_from_body)[:, :2] @ way
    behind = body_points(body, body.world_from_body)[:, :2] @ way
    shift = (ahead.max() - behind.min() + TOGETHER) * way
    return replace(body, world_from_body=rigid(translation=(*shift, 0.0)) @ body.world_from_body)


def _on_table(body: Body, site: TaskSite) -> Body:
    points = body_points(body, body.world_from_body)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    lift = site.table_height + DROP - points[:, 2].min()
    return replace(
        body, world_from_body=rigid(translation=(-middle[0], -middle[1], lift)) @ body.world_from_body
    )


def _circle(points: FloatArray) -> tuple[float, float, float]:
    """(x, y, radius) of a circle on the table that holds world points (N, 3), metres."""
    flat = points[:, :2]
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    return float(middle[0]), float(middle[1]), float(np.linalg.norm(flat - middle, axis=1).max())


def _circles(layout: Layout) -> list[tuple[float, float, float]]:
    """Circles (x, y, radius) on the table that the task's bodies occupy, including their joints' travel."""
    circles = [_circle(body_points(body, body.world_from_body)) for body in layout.bodies]
    for joint in layout.joints:
        points = body_points(layout[joint.child], layout[joint.child].world_from_body)
        if joint.kind == "prismatic":
            ends = [points + travel * np.asarray(joint.axis) for travel in joint.limits]
            circles.append(_circle(np.concatenate(ends)))
        else:
            x, y, _ = joint.origin
            radius = float(np.linalg.norm(points - np.asarray(joint.origin), axis=1).max())
            circles.append((float(x), float(y), radius))
    return circles


def _free_place(
    rng: np.random.Generator, site: TaskSite, radius: float, taken: Sequence[tuple[float, float, float]]
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
