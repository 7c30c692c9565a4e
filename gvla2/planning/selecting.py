"""Selecting: the leftmost or biggest of several objects, or the one in a relation to another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args

import numpy as np

from gvla2.planning.scene import Scene, SceneObject

Selector = Literal["left", "right", "near", "far", "middle", "big", "small", "tall", "short"]
SELECTORS: tuple[Selector, ...] = get_args(Selector)
"""``left`` and ``right``, ``near`` and ``far`` as the robot sees them; ``big`` by volume, ``tall`` by height."""

SIZE_SLACK, PLACE_SLACK = 0.05, 0.005
"""Differences of size (share) and place (metres) below perception's accuracy do not decide."""


def extreme(objects: Sequence[SceneObject], by: str, scene: Scene) -> list[SceneObject]:
    """The most extreme of ``objects`` by one of :data:`SELECTORS`, or all that are not clearly less so."""
    if by not in SELECTORS:
        raise ValueError(f"Unknown selector '{by}'; there are {', '.join(SELECTORS)}.")
    if not objects:
        return []
    space = scene.workspace
    foot = np.array([space.low[0], 0.5 * (space.low[1] + space.high[1])])
    middle = np.mean([o.centre[:2] for o in objects], axis=0)
    ranked_by: dict[str, Callable[[SceneObject], Any]] = {
        "left": lambda o: -o.centre[1],
        "right": lambda o: o.centre[1],
        "near": lambda o: np.linalg.norm(o.centre[:2] - foot),
        "far": lambda o: -np.linalg.norm(o.centre[:2] - foot),
        "middle": lambda o: np.linalg.norm(o.centre[:2] - middle),
        "big": lambda o: -np.prod(o.extents),
        "small": lambda o: np.prod(o.extents),
        "tall": lambda o: -o.extents[2],
        "short": lambda o: o.extents[2],
    }
    ranks = [float(ranked_by[by](o)) for o in objects]
    best = min(ranks)
    slack = SIZE_SLACK * abs(best) if by in ("big", "small", "tall", "short") else PLACE_SLACK
    return [o for o, r in zip(objects, ranks, strict=True) if r <= best + slack]


def located(objects: Sequence[SceneObject], relation: str, at: SceneObject) -> list[SceneObject]:
    """Those of ``objects`` in the relation to ``at``, which is not among them; the nearest of several.

    ``on``, ``in``, ``to`` and ``from`` mean over its footprint, or a part of it; x is behind, y to the left.
    """

    def holds(o: SceneObject) -> bool:
        dx, dy = (o.centre - at.centre)[:2]
        match relation:
            case "on" | "in" | "to" | "from":
                reach = 0.5 * float(np.linalg.norm(at.extents[:2])) + 0.01
                return bool(np.hypot(dx, dy) < reach) or o.parent == at.id
            case "left_of":
                return bool(dy > 0.01)
            case "right_of":
                return bool(dy < -0.01)
            case "behind":
                return bool(dx > 0.01)
            case "front_of":
                return bool(dx < -0.01)
        return True

    there = [o for o in objects if o.id != at.id and holds(o)]
    gaps = [float(np.linalg.norm((o.centre - at.centre)[:2])) for o in there]
    return [o for o, g in zip(there, gaps, strict=True) if g <= min(gaps) + PLACE_SLACK]
