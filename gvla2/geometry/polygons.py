"""Polygons as triangles."""

from __future__ import annotations

import re

import numpy as np
from mapbox_earcut import triangulate_float64

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
        return "".join(f"\nf {' '.join(words[k] for k in triangle)}" for triangle in triangles_of(points[at]))

    return re.sub(polygon, cut, text)


def triangles_of(corners: FloatArray) -> list[tuple[int, ...]]:
    """The triangles of a polygon with ``corners`` (N, 3), by their numbers: a fan where it is convex, or
    crosses itself.
    """
    if (count := len(corners)) == 3:
        return [(0, 1, 2)]
    corners = corners - corners[0]
    fan: list[tuple[int, ...]] = [(0, k, k + 1) for k in range(1, count - 1)]
    up = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    turns = np.cross(corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners) @ up
    if (turns >= -1e-9 * (up @ up)).all():
        return fan
    seen = np.delete(corners, np.abs(up).argmax(), axis=1)  # along an axis
    found = triangulate_float64(np.ascontiguousarray(seen), np.array([count], np.uint32)).reshape(-1, 3)
    a, b, c = (corners[found[:, k]] for k in range(3))
    turned = np.cross(b - a, c - a) @ up < 0
    found[turned] = found[turned][:, ::-1]
    return [tuple(one) for one in found.tolist()] if len(found) == count - 2 else fan
