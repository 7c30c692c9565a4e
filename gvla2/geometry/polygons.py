"""Polygons as triangles."""

from __future__ import annotations

import re

import numpy as np

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray


def without_polygons(text: str) -> str:
    """An OBJ file's text with triangles for the faces of more than four corners, which trimesh takes to be convex."""
    polygon = r"\nf((?: +\S+){5,})"
    points = np.array(
        re.findall(r"\nv +(\S+) +(\S+) +(\S+)", text) if re.search(polygon, text) else [], np.float64
    )

    def cut(face: re.Match[str]) -> str:
        words = face[1].split()
        named = [int(word.partition("/")[0]) for word in words]
        before = text.count("\nv ", 0, face.start()) if min(named) < 0 else 0
        at = [number - 1 if number > 0 else before + number for number in named]
        if max(at) >= len(points):
            return face[0]  # trimesh says so
        return "".join(f"\nf {' '.join(words[k] for k in ear)}" for ear in ears(points[at]))

    return re.sub(polygon, cut, text)


MOST_CORNERS = 500
"""Of a face whose ears are cut off: the time grows with their square."""


def ears(corners: FloatArray) -> list[tuple[int, ...]]:
    """The triangles of a polygon with ``corners`` (N, 3), by their numbers: a fan where it is convex, or crosses
    itself; else its ears, which are cut off one after another. Raises :class:`GeometryError` for too many.
    """
    if (count := len(corners)) == 3:
        return [(0, 1, 2)]
    corners = corners - corners[0]
    fan: list[tuple[int, ...]] = [(0, k, k + 1) for k in range(1, count - 1)]
    up = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    turns = np.cross(corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners) @ up
    if (turns >= -1e-9 * (up @ up)).all():
        return fan
    if count > MOST_CORNERS:
        raise GeometryError(f"a face has {count} corners and is not convex; export triangles.")
    left, cut = list(range(count)), list[tuple[int, ...]]()
    while len(left) > 3:
        for place, tip in enumerate(left):
            ear = (left[place - 1], tip, left[(place + 1) % len(left)])
            ends = corners[list(ear)]
            ways = np.roll(ends, -1, axis=0) - ends
            others = corners[[k for k in left if not (corners[k] == ends).all(axis=1).any()]]
            inside = (np.cross(ways, others[:, None] - ends) @ up >= 0).all(axis=1)
            if np.cross(ways[0], ways[1]) @ up > 0 and not inside.any():
                break
        else:
            return fan
        cut.append(ear)
        left.remove(tip)
    return [*cut, tuple(left)]
