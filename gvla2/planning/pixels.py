"""From pixels to the scene: the 3D point that a pixel shows, the object there, and the 3D course of a drawn path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.errors import PlanningError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene, SceneObject

TOUCHING = 0.008
"""A point this near to an object's box counts as on it, metres: the error of depth cameras and perceived boxes."""
AGREE = 0.01
"""Neighbouring depths that differ by less lie on one surface, metres."""
NEIGHBOURS = 9
"""Number of valid pixels used for a depth: a patch of 3 by 3 if none is missing."""
EDGE_ON = 0.3
"""Sine of the least angle between a line of sight and the vertical plane that it intersects."""
OVERSHOOT = 0.25
"""How far a path may extend beyond both its ends, as a share of its length."""


@dataclass(frozen=True)
class Pixel:
    """A place in a camera's picture, in pixels.

    ``u`` counts to the right and ``v`` down, from the upper left corner: the first pixel's centre is at (0.5, 0.5).
    """

    camera: str
    u: float
    v: float


@dataclass(frozen=True)
class Sighting:
    """What a pixel shows: ``point`` (3,) in the world, metres, and the id of the ``object`` there, "" for none."""

    pixel: Pixel
    point: FloatArray
    object: str = ""


def view_of(observation: Observation, camera: str = "") -> View:
    """The view of that name, the first one for ""; raises :class:`PlanningError` if there is none."""
    names = [view.name for view in observation.views]
    if camera and camera not in names:
        raise PlanningError(f"There is no camera '{camera}'; the observation has {', '.join(names)}.")
    return observation.views[names.index(camera) if camera else 0]


def pixel_at(view: View, u: float, v: float) -> Pixel:
    """The pixel at the shares ``u`` and ``v`` of a picture's width and height, 1 being its last pixel."""
    width, height = view.camera.width, view.camera.height
    return Pixel(view.name, min(u * width, width - 0.5), min(v * height, height - 0.5))


def sight(pixel: Pixel, observation: Observation, scene: Scene, reach: int = 12) -> Sighting:
    """What is seen at ``pixel``; if depth is missing, at the nearest pixels that have it, at most ``reach`` pixels
    away.

    Raises :class:`PlanningError` for a pixel outside the picture, a camera that is missing or has no depth, and if no
    depth was measured nearby. Pixels of the robot's own arm count as not measured.
    """
    view = view_of(observation, pixel.camera)
    depth = depth_at(view, pixel, reach)
    point = view.camera.position + depth * direction(view.camera, pixel)
    return Sighting(pixel, point, object_at(point, scene))


def depth_at(view: View, pixel: Pixel, reach: int = 12) -> float:
    """Metres along the camera's z at ``pixel``: the median of the nearest measured depths on one surface.

    An isolated pixel (a flying pixel at an edge) is outvoted by its neighbours; one confirmed by some of them is used,
    so that a thin handle is not mistaken for what lies behind it.
    """
    u, v = pixel.u, pixel.v
    size = f"{view.camera.width} by {view.camera.height} pixels"
    if not bool(view.camera.inside(np.array([u, v]))):
        raise PlanningError(
            f"The point ({u:.1f}, {v:.1f}) lies outside the picture of '{view.name}', {size}."
        )
    if view.depth is None:
        raise PlanningError(f"The camera '{view.name}' measures no depth; choose one that does.")
    row, column = int(v), int(u)
    top, left = max(0, row - reach), max(0, column - reach)
    patch = (slice(top, row + reach + 1), slice(left, column + reach + 1))
    depths = view.depth[patch].astype(np.float64)
    known = np.isfinite(depths) & (depths > 0.0)
    if view.robot_mask is not None:
        known &= ~view.robot_mask[patch]
    rows, columns = np.nonzero(known)
    off = np.hypot(rows + top + 0.5 - v, columns + left + 0.5 - u)
    near = np.argsort(off, kind="stable")[:NEIGHBOURS]
    near = near[off[near] <= reach]
    if not len(near):
        raise PlanningError(
            f"No depth was measured within {reach} pixels of ({u:.0f}, {v:.0f}) in the picture of '{view.name}'."
        )
    found = depths[rows[near], columns[near]]
    beside = np.abs(found - found[0]) < AGREE
    return float(np.median(found[beside] if beside.sum() >= min(3, len(found)) else found))


def direction(camera: Camera, pixel: Pixel) -> FloatArray:
    """(3,) the pixel's line of sight in the world, as long as one metre along the camera's z."""
    local = np.linalg.solve(camera.K, np.array([pixel.u, pixel.v, 1.0]))
    return np.asarray(camera.world_from_camera[:3, :3] @ local)


def object_at(point: FloatArray, scene: Scene, within: float = TOUCHING) -> str:
    """The id of the object that a point (3,) is on or in, "" for none; of a whole and its part, the part."""
    near = [o for o in scene.objects if o.distances(point) <= within]
    if not near:
        return ""
    # Boxes of hollow objects and their contents overlap: take the one whose surface was seen nearest.
    seen = [_to_surface(point, o) for o in near]
    best = min(seen)
    same = [o for o, gap in zip(near, seen, strict=True) if gap <= best + 0.5 * TOUCHING]
    return min(same, key=lambda o: (not o.parent, float(np.prod(o.extents)))).id


def object_near(pixel: Pixel, view: View, scene: Scene, within: float) -> str:
    """The id of the object whose seen points come nearest to a pixel in the picture, ``within`` pixels; "" for none."""
    best, found = within, ""
    for obj in scene.objects:
        uv, _ = view.camera.project(obj.points if len(obj.points) else obj.centre[None])
        gaps = np.hypot(uv[:, 0] - pixel.u, uv[:, 1] - pixel.v)
        gap = float(np.min(gaps[np.isfinite(gaps)], initial=np.inf))
        if gap <= best:
            best, found = gap, obj.id
    return found


def _to_surface(point: FloatArray, obj: SceneObject) -> float:
    if not len(obj.points):
        return float(obj.distances(point))
    return float(np.sqrt(np.min(np.sum((obj.points - point) ** 2, axis=1))))


def path_in_air(
    camera: Camera,
    pixels: Sequence[Pixel],
    anchors: Mapping[int, FloatArray],
    scene: Scene,
    start: FloatArray,
) -> FloatArray:
    """(N, 3) world points of a path drawn in one picture, metres; NaN where it leaves the workspace.

    ``anchors`` gives the points (3,) of those pixels that lie on objects, by index: their depth is known. A pixel
    between two of them shows what lies behind the path, not the path. Two rules give it a place on its line of sight:
    the path runs in the vertical plane through its two anchors, so that higher in the picture is higher in space; and
    if that plane is seen edge on, at a height interpolated between the anchors'. ``start`` (3,) is where the tool is
    before the first pixel; after the last anchor the plane faces the camera.
    """
    found = np.full((len(pixels), 3), np.nan)
    uv = np.array([[p.u, p.v] for p in pixels]).reshape(-1, 2)
    ends = sorted(anchors)
    for index in ends:
        found[index] = anchors[index]
    for begin, end in zip([-1, *ends], [*ends, len(pixels)], strict=True):
        a = found[begin] if begin >= 0 else start
        b = found[end] if end < len(pixels) else None
        drawn = uv[max(begin, 0) : end + 1]
        reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(drawn, axis=0), axis=1))])
        for index in range(begin + 1, min(end, len(pixels))):
            share = float(reached[index - max(begin, 0)] / max(reached[-1], 1e-9))
            found[index] = _in_air(camera, pixels[index], a, b, share, scene)
    return found


def _in_air(
    camera: Camera, pixel: Pixel, a: FloatArray, b: FloatArray | None, share: float, scene: Scene
) -> FloatArray:
    ray, eye = direction(camera, pixel), camera.position
    ahead = np.array([*camera.world_from_camera[:2, 2], 0.0])
    span = None if b is None else (b - a) * [1.0, 1.0, 0.0]
    length = 0.0 if span is None else float(np.linalg.norm(span))
    normal = ahead if span is None or length < 2 * AGREE else np.cross([0.0, 0.0, 1.0], span)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
    found = _cut(eye, ray, normal, a)
    if found is not None and span is not None and length >= 2 * AGREE:
        along = float((found - a) @ span) / length**2
        found = found if -OVERSHOOT <= along <= 1.0 + OVERSHOOT else None
    if found is not None and scene.workspace.contains(found) and found[2] >= scene.table_height:
        return found
    height = a[2] if b is None else (1.0 - share) * a[2] + share * b[2]
    level = _cut(eye, ray, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, height]))
    return level if level is not None and scene.workspace.contains(level) else np.full(3, np.nan)


def _cut(eye: FloatArray, ray: FloatArray, normal: FloatArray, on: FloatArray) -> FloatArray | None:
    """Where a line of sight meets a plane in front of the camera; None if it is nearly parallel."""
    slope = float(normal @ ray)
    if abs(slope) < EDGE_ON * float(np.linalg.norm(ray)):
        return None
    depth = float(normal @ (on - eye)) / slope
    return eye + depth * ray if depth > 0.0 else None
