"""What the tasks share: the frame of a task and its episodes, colours and paint, solids."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS, colours_in
from gvla2.robot.solids import distinct, sample_root, sample_until
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop import ScaledConfig

T = TypeVar("T")
C = TypeVar("C", bound=ScaledConfig)
Rgb = tuple[float, float, float]
Sides = tuple[float, float, float]
Check = Callable[[WorldState], bool]

DOWN, UP = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])

PAINT = 0.0005
"""Thickness of what is painted on the table, metres."""


@dataclass(frozen=True)
class Draw:
    """The random draws of one episode, in order; ``given`` is the user's sentence, if any."""

    rng: np.random.Generator
    site: TaskSite
    templates: Sequence[str]
    given: str | None = None

    def root(self, yaw: float = np.pi) -> FloatArray:
        """world_from_root (4, 4) on the table, turned by up to ``yaw`` either way."""
        return sample_root(self.rng, self.site, yaw)

    def angle(self) -> float:
        """Any angle, radians."""
        return float(self.rng.uniform(-np.pi, np.pi))

    def colours(self, count: int, beside: Iterable[Rgb] = ()) -> tuple[str, ...]:
        """``count`` colour words, each distinct from the others, from the table and from the colours ``beside``.

        The first ones are those required by the site.
        """
        given = self.site.colours[:count]
        taken = [*beside, *([self.site.table_rgb] if self.site.table_rgb is not None else [])]
        names = [name for name in COLOURS if distinct(COLOURS[name], taken)]

        def draw() -> tuple[str, ...] | None:
            free = [name for name in names if name not in given]
            if len(free) < count - len(given):
                return None
            more = self.rng.choice(len(free), size=count - len(given), replace=False)
            chosen = [*given, *(free[i] for i in more)]
            clear = all(distinct(COLOURS[chosen[i]], [COLOURS[c] for c in chosen[:i]]) for i in range(count))
            return tuple(chosen) if clear else None

        return sample_until(draw, f"{count} colours")

    def named(self, colours: Sequence[str], default: int) -> tuple[int, str]:
        """Which of ``colours`` the given sentence names, and a remark for the goal when it names no single one."""
        if self.given is None:
            return default, ""
        named = [i for i, colour in enumerate(colours) if colour in colours_in(self.given)]
        if len(named) == 1:
            return named[0], ""
        return default, "; the sentence names none by its colour alone, so the seed's own target is judged"

    def instance(
        self,
        layout: Layout,
        relaxed: Check,
        strict: Check,
        goal: str,
        *,
        image_size: int = 0,
        **words: str,
    ) -> TaskInstance:
        """The episode; its sentence is one of the templates with ``words`` filled in, or the given one."""
        drawn = self.templates[int(self.rng.integers(len(self.templates)))].format(**words)
        return TaskInstance(
            drawn if self.given is None else self.given,
            layout,
            {"relaxed": relaxed, "strict": strict},
            goal,
            image_size=image_size,
        )


class TabletopTask(ABC, Generic[C]):
    """Base of the tasks. ``instructions`` are paraphrases with the words of colours to be filled in.

    ``config`` are the options, ``scale`` multiplies the objects' sizes. Raises :class:`ConfigurationError`.
    """

    name: ClassVar[str]
    largest_scale: ClassVar[float] = 1.2
    instructions: tuple[str, ...]

    def __init__(self, config: C) -> None:
        self.config, self.scale = config, config.factor(self.name, self.largest_scale)
        self.check(config)

    def check(self, config: C) -> None:
        """Raise :class:`ConfigurationError` for invalid options."""

    @abstractmethod
    def lay_out(self, draw: Draw) -> TaskInstance:
        """Draw one episode."""

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode. An ``instruction`` that names one of several candidates by its colour decides the target."""
        return self.lay_out(Draw(rng, site, self.instructions, instruction))


def scaled(k: float, sides: Sequence[float]) -> Sides:
    """Three sides times ``k``."""
    x, y, z = (float(k * side) for side in sides)
    return x, y, z


def lifted(z: float, x: float = 0.0) -> FloatArray:
    """(4, 4) the shift by ``z`` and ``x`` metres."""
    return rigid(translation=(x, 0.0, z))


def box(size: Sequence[float], rgb: Rgb, place: Sequence[float] = (0.0, 0.0, 0.0), **more: Any) -> Primitive:
    """A box of full sides (3,), its middle at ``place`` (3,) in its body's frame; metres."""
    return Primitive("box", scaled(1.0, size), rgb, rigid(translation=place), **more)


def cylinder(diameter: float, low: float, high: float, rgb: Rgb, x: float = 0.0, **more: Any) -> Primitive:
    """An upright cylinder from ``low`` to ``high`` in its body's frame; metres."""
    return Primitive("cylinder", (diameter, diameter, high - low), rgb, lifted((low + high) / 2, x), **more)


def square(place: FloatArray, side: float, colour: str, name: str = "target") -> Body:
    """A square painted on the table about the pose ``place`` (4, 4); ``side`` in metres."""
    paint = box((side, side, PAINT), COLOURS[colour], collides=False)
    return Body(name, (paint,), place @ lifted(PAINT / 2), fixed=True, label=f"{colour} square")


def around(axis: FloatArray, start: FloatArray, count: int) -> list[FloatArray]:
    """``count`` directions (3,): ``start`` turned evenly all the way about ``axis``."""
    turns = 2.0 * np.pi * np.arange(count) / count
    return [Rotation.from_rotvec(axis * turn).as_matrix() @ start for turn in turns]


def raised(pose: FloatArray, height: float) -> FloatArray:
    """The pose (4, 4) moved up by ``height`` metres."""
    return rigid(translation=UP * height) @ pose
