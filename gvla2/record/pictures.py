"""All pictures of a run, made one by one so that a failure does not affect the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from gvla2.episode.record import EpisodeRecord
from gvla2.episode.refine import Refinement
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View
from gvla2.io.foreign import png_bytes
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory
from gvla2.record.drawing import (
    INK,
    PAPER,
    Canvas,
    Colour,
    Point,
    Rect,
    enlarged,
    marker_colour,
    part_about,
)

OPEN_COLOUR: Colour = (120, 214, 255)
CLOSED_COLOUR: Colour = (255, 168, 60)
BEFORE_COLOUR: Colour = (86, 180, 255)
AFTER_COLOUR: Colour = (255, 168, 60)
TRUE_COLOUR: Colour = (90, 214, 120)
"""Boxes as perceived, as refined and as they are."""

_EDGES = tuple((a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4))
_SEEN = 0.03  # share of an object's points that must be visible for its label


def perception_overlay(view: View, scene: Scene, width: int = 640) -> Image.Image:
    """The view with the oriented box of each scene object, numbered in the scene's order.

    An object hidden from this camera (by the view's depth) is faint and has no label.
    """
    canvas = Canvas(view.image, width)
    eye = view.camera.position
    order = sorted(enumerate(scene.objects), key=lambda item: -float(np.linalg.norm(item[1].centre - eye)))
    for index, obj in order:
        seen = in_sight(view, obj)
        if seen > 0:
            _draw_box(canvas, view.camera, obj, marker_colour(index), hidden=seen < _SEEN)
    for index, obj in reversed(order):
        near = _bounds(view.camera, obj)
        if near is not None and in_sight(view, obj) >= _SEEN:
            canvas.label(obj.label or obj.id, near, marker_colour(index), badge=str(index + 1))
    return canvas.picture()


def in_sight(view: View, obj: SceneObject) -> float:
    """Share of the object's points (of its box's corners, if it has none) that this view sees.

    A point is seen when it falls into the image and the view's depth there is not more than 2 cm nearer.
    """
    points = obj.points if len(obj.points) else obj.corners()
    points = points[:: max(1, len(points) // 200)]
    uv, depth = view.camera.project(points)
    inside = view.camera.inside(uv)
    if view.depth is None or not inside.any():
        return float(inside.mean())
    columns, rows = np.floor(uv[inside]).astype(int).T
    behind = depth[inside] > view.depth[rows, columns] + 0.02  # NaN compares as not behind
    return float((~behind).sum() / len(points))


def plan_views(views: Iterable[View], trajectory: Trajectory, count: int = 2) -> list[View]:
    """The views that show the path best: most waypoints in the picture, a front camera first when equal.

    A camera on the hand moves away from its view, so it is used only if there is no other.
    """

    def rank(view: View) -> tuple[bool, bool, int]:
        shown = int(view.camera.inside(view.camera.project(_stops(trajectory))[0]).sum())
        return "wrist" not in view.name, "front" in view.name and shown > 0, shown

    return sorted(views, key=rank, reverse=True)[:count]


def plan_overlay(
    view: View,
    trajectory: Trajectory,
    start: FloatArray | None = None,
    scene: Scene | None = None,
    width: int = 640,
) -> Image.Image:
    """The waypoint path in the view: numbered dots (from 0, as in files and messages) and grips.

    ``start`` (3,) is the tool's position before, metres. Light blue is an open gripper, orange a closed one. The
    picture shows the part of the view with the path and the objects of ``scene``.
    """
    camera, waypoints = view.camera, list(trajectory)
    stops = _stops(trajectory)
    path = stops if start is None else np.vstack([start, stops])
    shown = np.vstack([stops, *(obj.corners() for obj in (scene.objects if scene else ()))])
    pixels, size = camera.project(shown)[0], (camera.width, camera.height)
    part = part_about(pixels[camera.inside(pixels)], size, grow=1.2, least=0.5 * min(size))
    canvas = Canvas(view.image, width, part)
    openings = [1.0, *(w.gripper for w in waypoints)]
    first = 0 if start is not None else 1
    for a, b, opening, waypoint in zip(path, path[1:], openings[first:], waypoints[first:], strict=False):
        leg = camera.project(np.linspace(a, b, 16))[0]
        canvas.line(leg, _grip_colour(opening), width=3.5 if waypoint.carries else 2.5)
    for at, members in _clusters(camera, stops, canvas.scale):
        last = waypoints[members[-1]]
        numbers = "·".join(str(k) for k in members)
        canvas.dot(at, 9.5, PAPER if last.gripper > 0.5 else CLOSED_COLOUR, ring=INK, text=numbers)
    return canvas.picture()


def _stops(trajectory: Trajectory) -> FloatArray:
    """(N, 3) the waypoints' positions."""
    return trajectory.xyzg().reshape(-1, 4)[:, :3]


def _clusters(camera: Camera, stops: FloatArray, scale: float) -> list[tuple[Point, list[int]]]:
    """Waypoints in the picture, grouped if their dots would overlap: (pixel, all of them)."""
    clusters: list[tuple[Point, list[int]]] = []
    for k, (u, v) in enumerate(camera.project(stops)[0].tolist()):
        if not camera.inside(np.array([u, v])):
            continue
        for at, members in clusters:
            if np.hypot(at[0] - u, at[1] - v) * scale < 17:
                members.append(k)
                break
        else:
            clusters.append(((u, v), [k]))
    return clusters


def _grip_colour(opening: float) -> Colour:
    return OPEN_COLOUR if opening > 0.5 else CLOSED_COLOUR


def _draw_box(canvas: Canvas, camera: Camera, obj: SceneObject, colour: Colour, hidden: bool) -> None:
    pixels, _ = camera.project(obj.corners())
    for edge in _EDGES:
        canvas.line(pixels[list(edge)], colour, width=1.0 if hidden else 2.0, alpha=110 if hidden else 255)


def _bounds(camera: Camera, obj: SceneObject) -> Rect | None:
    uv, _ = camera.project(obj.corners())
    if not np.isfinite(uv).all() or not camera.inside(uv).any():
        return None
    box = np.clip([uv.min(axis=0), uv.max(axis=0)], 0, [camera.width, camera.height])
    return Rect(*box.ravel().tolist())


Shots = Mapping[str, bytes]
"""PNG files by their captions, mostly cameras' names."""


@dataclass
class Pictures:
    """The page's pictures; empty if not made.

    ``plain`` are the cameras' pictures as taken, ``objects`` those with the perceived objects,
    ``refined`` the boxes of each object that was refined, ``plan`` the planned path in some of them. ``film`` is the
    motion as MP4, ``model`` the scene with the plan as GLB.
    """

    plain: Shots = field(default_factory=dict)
    objects: Shots = field(default_factory=dict)
    refined: Shots = field(default_factory=dict)
    plan: Shots = field(default_factory=dict)
    before: bytes = b""
    after: bytes = b""
    film: bytes = b""
    model: bytes = b""


def main_picture(observation: Observation) -> bytes:
    """The picture for before and after, of a front camera if there is one, else of the first."""
    views = observation.views
    main = next((v for v in views if "front" in v.name), views[0])
    return png_bytes(enlarged(Image.fromarray(observation.shown(main).image), 512))


def plain_pictures(observation: Observation) -> Shots:
    """Each camera's picture."""
    return {view.name: png_bytes(view.image) for view in observation.pictured()}


def object_pictures(observation: Observation, scene: Scene) -> Shots:
    """Each camera's picture with the perceived objects."""
    return {view.name: png_bytes(perception_overlay(view, scene)) for view in observation.pictured()}


def plan_pictures(
    observation: Observation, trajectory: Trajectory, scene: Scene | None, count: int = 2
) -> Shots:
    """The planned path in the ``count`` cameras that show it best."""
    start = observation.world_from_tcp[:3, 3]

    def drawn(view: View) -> bytes:
        return png_bytes(plan_overlay(view, trajectory, start, scene))

    return {v.name: drawn(v) for v in plan_views(observation.pictured(), trajectory, count)}


def refined_pictures(observation: Observation, refined: Sequence[Refinement]) -> Shots:
    """By label, the part of a picture that shows an object best, with its perceived, refined and true boxes."""
    made = {}
    for number, one in enumerate(refined, 1):
        view = max(observation.pictured(), key=lambda view: in_sight(view, one.before))
        boxes = [(one.before, BEFORE_COLOUR), (one.after, AFTER_COLOUR), (one.true, TRUE_COLOUR)]
        corners = np.concatenate([view.camera.project(obj.corners())[0] for obj, _ in boxes if obj])
        size = (view.camera.width, view.camera.height)
        canvas = Canvas(view.image, 420, part_about(corners, size, grow=1.3, least=0.1 * min(size)))
        for obj, colour in boxes:
            if obj is not None:
                _draw_box(canvas, view.camera, obj, colour, hidden=False)
        made[f"{number} {one.before.label}, {view.name}"] = png_bytes(canvas.picture())
    return made


class Shown(NamedTuple):
    """A field of :class:`Pictures` that is made during a run: its name in notes, and ``make``, called with ``inputs``.

    It waits until none of the inputs is None. ``file`` in the run's folder also holds it, "" for none.
    """

    called: str
    inputs: Callable[[EpisodeRecord], tuple[Any, ...]]
    make: Callable[..., bytes | Shots]
    file: str = ""


SHOWN: Mapping[str, Shown] = {
    "before": Shown("The picture before", lambda r: (r.observation,), main_picture, "before.png"),
    "plain": Shown("The cameras' pictures", lambda r: (r.observation,), plain_pictures),
    "objects": Shown(
        "The picture of the objects", lambda r: (r.observation, r.scene), object_pictures, "perception.png"
    ),
    "refined": Shown("The boxes", lambda r: (r.observation, r.refined), refined_pictures, "refined.png"),
    "plan": Shown(
        "The picture of the plan",
        lambda r: (r.observation, r.plan and r.plan.trajectory, r.scene),
        plan_pictures,
        "plan.png",
    ),
    "after": Shown("The picture after", lambda r: (r.after,), main_picture, "after.png"),
}
"""By the field of :class:`Pictures`, in the order in which a run makes them."""
