"""What the tasks share: colours and paint, solids at a height, sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS, DISTINCT, colour_distance, colours_in
from gvla2.robot.placing import sample_until
from gvla2.robot.task import Body, Primitive, TaskSite

Rgb = tuple[float, float, float]

PAINT = 0.0005
"""Thickness of what is painted on the table, metres."""


def sample_colours(
    rng: np.random.Generator, site: TaskSite, count: int, beside: Iterable[Rgb] = ()
) -> tuple[str, ...]:
    """``count`` colour words, each distinct from the others, from the table and from the colours ``beside``.

    The first ones are those required by the site.
    """
    given = site.colours[:count]
    taken = [*beside, *([site.table_rgb] if site.table_rgb is not None else [])]
    names = [name for name in COLOURS if _apart(COLOURS[name], taken)]

    def draw() -> tuple[str, ...] | None:
        free = [name for name in names if name not in given]
        if len(free) < count - len(given):
            return None
        more = rng.choice(len(free), size=count - len(given), replace=False)
        chosen = [*given, *(free[i] for i in more)]
        clear = all(_apart(COLOURS[chosen[i]], [COLOURS[c] for c in chosen[:i]]) for i in range(count))
        return tuple(chosen) if clear else None

    return sample_until(draw, f"{count} colours")


def _apart(rgb: Rgb, others: list[Rgb]) -> bool:
    return not others or bool((colour_distance(np.array(others), rgb) >= DISTINCT).all())


def sentence_of(rng: np.random.Generator, templates: Sequence[str], given: str | None, **words: str) -> str:
    """One of the templates with the words filled in; a ``given`` sentence wins, after the same draw."""
    drawn = templates[int(rng.integers(len(templates)))].format(**words)
    return drawn if given is None else given


def named_by_colour(given: str | None, colours: Sequence[str], default: int) -> tuple[int, str]:
    """Which of ``colours`` a given sentence names, and a remark for the goal when it names no single one."""
    if given is None:
        return default, ""
    said = colours_in(given)
    named = [i for i, colour in enumerate(colours) if colour in said]
    if len(named) == 1:
        return named[0], ""
    return default, "; the sentence names none by its colour alone, so the seed's own target is judged"


def lifted(z: float, x: float = 0.0) -> FloatArray:
    """(4, 4) the shift by ``z`` and ``x`` metres."""
    return rigid(translation=(x, 0.0, z))


def square(place: FloatArray, side: float, colour: str, name: str = "target") -> Body:
    """A square painted on the table about the pose ``place`` (4, 4); ``side`` in metres."""
    paint = Primitive("box", (side, side, PAINT), COLOURS[colour], collides=False)
    return Body(name, (paint,), place @ lifted(PAINT / 2), fixed=True, label=f"{colour} square")
