"""Waypoints as language models write them: their grammar, their schema, and their places in the scene."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gvla2.language import json_in
from gvla2.planning.scene import Scene
from gvla2.skills.path_lifting import MOST_POINTS, PathPoint

FARTHEST = 1000.0
"""Largest offset, millimetres."""
Step = Sequence[Any]
"""``[name, dx, dy, up, g]`` or ``[name, other, along, up, g]``, millimetres."""


def read_steps(text: str, ids: Mapping[str, str]) -> list[Step]:
    """The waypoints of an answer, with names as written. Raises :class:`ValueError` with a sentence for the model."""
    found = json_in(text)
    if isinstance(found, dict):
        found = next((v for v in found.values() if isinstance(v, list)), None)
    if not isinstance(found, list) or not found or not all(isinstance(s, list) for s in found):
        raise ValueError("It is not a list of waypoints, each a list.")
    if len(found) > MOST_POINTS:
        raise ValueError(f"It has {len(found)} waypoints; {MOST_POINTS} at most can be executed.")
    return [_checked(step, ids) for step in found]


def _checked(step: list[Any], ids: Mapping[str, str]) -> Step:
    shown = json.dumps(step)[:80]
    if len(step) != 5:
        raise ValueError(f"{shown} is not a waypoint: it needs five elements.")
    towards = isinstance(step[1], str)
    names, numbers = step[: 1 + towards], step[1 + towards :]
    for name in names:
        if not isinstance(name, str) or name not in ids:
            raise ValueError(f"There is nothing called {json.dumps(name)[:80]}; there are {', '.join(ids)}.")
    if towards and names[0] == names[1]:
        raise ValueError(f"{names[0]} is not on the way to itself.")
    if not all(isinstance(n, int | float) and not isinstance(n, bool) for n in numbers):
        raise ValueError(f"{shown} has an element that is neither a name nor a number.")
    if not all(abs(n) <= FARTHEST for n in numbers) or not 0 <= numbers[-1] <= 1:
        raise ValueError(f"{shown} has a number out of range: millimetres, and g from 0 to 1.")
    return step


def written(steps: Sequence[Step]) -> str:
    """Waypoints as an answer has them."""
    return json.dumps(steps, separators=(",", ":"))


def path_of(steps: Sequence[Step], ids: Mapping[str, str], scene: Scene) -> list[PathPoint]:
    """The points of the hand's path, world metres."""
    points = []
    for name, second, third, up, g in steps:
        first = scene[ids[name]]
        if isinstance(second, str):
            direction = (scene[ids[second]].centre - first.centre)[:2]
            offset = 1e-3 * third * direction / max(float(np.linalg.norm(direction)), 1e-9)
        else:
            offset = 1e-3 * np.array([second, third])
        x, y = (float(v) for v in first.centre[:2] + offset)
        points.append(PathPoint((x, y, first.top + 1e-3 * up), float(g), first.id))
    return points


def grammar(names: Sequence[str], *, max_points: int = MOST_POINTS) -> str:
    """llama.cpp's grammar of an answer: a plain list, which takes the fewest tokens, of at most ``max_points``."""
    lines = (
        f'root ::= "[" point ("," point){{1,{max(2, max_points) - 1}}} "]"',
        'point ::= "[" name "," ((int "," int) | (name "," int)) "," int "," [01] "]"',
        f"name ::= {' | '.join(json.dumps(json.dumps(n)) for n in names)}",
        'int ::= "-"? [0-9]{1,3}',
    )
    return "\n".join(lines) + "\n"
