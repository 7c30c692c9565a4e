"""Episodes with two things that the sentence cannot tell apart: such instructions must be refused."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from gvla2.planning.colours import SYNONYMS, colours_in
from gvla2.robot.task import Body, Layout, Primitive, Task, TaskInstance, TaskSite


class TwinTask:
    """Implements :class:`gvla2.robot.task.Task`: another task whose named thing has twins (see :func:`with_twins`)."""

    def __init__(self, task: Task) -> None:
        self._task, self.instructions = task, task.instructions

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's own episode, with twins if its sentence allows them."""
        instance = self._task.sample(rng, site, instruction)
        return with_twins(instance) or instance


def with_twins(instance: TaskInstance) -> TaskInstance | None:
    """The episode in which every body of the same shape as one that the sentence names by colour is painted like it.

    None when the sentence names no thing by its colour, or no other body has its shape. Things that the sentence names
    by a different colour stay as they are: "the red and the blue one" are two things, not twins.
    """
    said = set(_plain(instance.instruction).split())
    layout = instance.layout
    for body in layout.bodies:
        twins = {other.name for other in layout.bodies if _alike(body, other) and not _named(other, said)}
        if _named(body, said) and twins:
            bodies = tuple(_painted(other, body) if other.name in twins else other for other in layout.bodies)
            painted: Layout = replace(layout, bodies=bodies)
            return replace(instance, layout=painted)
    return None


def _plain(words: str) -> str:
    """Lower-case words; a colour's synonym is that colour."""
    return " ".join(SYNONYMS.get(word, word) for word in re.findall(r"[a-z]+", words.lower()))


def _named(body: Body, said: set[str]) -> bool:
    """Whether a colour of the body's label is among the spoken words."""
    return bool(said.intersection(colours_in(body.label)))


def _alike(one: Body, other: Body) -> bool:
    """Whether two bodies have the same shape and, colours aside, the same name."""
    if not one.label or one.label == other.label or _uncoloured(one.label) != _uncoloured(other.label):
        return False
    return len(one.solids) == len(other.solids) and all(
        a.kind == b.kind and np.allclose(a.size, b.size) and np.allclose(a.body_from_shape, b.body_from_shape)
        for a, b in zip(one.solids, other.solids, strict=True)
    )


def _uncoloured(label: str) -> str:
    colours = colours_in(label)
    return " ".join(word for word in _plain(label).split() if word not in colours)


def _painted(body: Body, like: Body) -> Body:
    solids = tuple(
        replace(solid, rgb=model.rgb) if isinstance(solid, Primitive) else solid
        for solid, model in zip(body.solids, like.solids, strict=True)
    )
    return replace(body, solids=solids, label=like.label)
