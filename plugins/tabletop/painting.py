"""Colours of things: words that people can distinguish in any light, on this table."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gvla2.planning.colours import COLOURS, TOLD_APART, colour_distance
from gvla2.robot.placing import sample_until
from gvla2.robot.task import TaskSite

Rgb = tuple[float, float, float]

PAINT = 0.0005
"""Thickness of what is painted on the table, metres."""


def sample_colours(
    rng: np.random.Generator, site: TaskSite, count: int, beside: Iterable[Rgb] = ()
) -> tuple[str, ...]:
    """``count`` colour words, each told apart from the others, from the table and from the colours ``beside``.

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
    return not others or bool((colour_distance(np.array(others), rgb) >= TOLD_APART).all())
