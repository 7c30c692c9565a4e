"""Maps of the table as SVG: from above, and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory
from gvla2.record.drawing import css_colour, marker_colour, shorten
from gvla2.record.placement import Rect, around, place

_WIDTH = 460.0  # SVG units of a map; the page scales it
_MARGIN = 0.07  # metres of free space about what is shown
_LEAST = 0.30  # metres shown at least, so that one small object does not fill the map


@dataclass(frozen=True)
class _Frame:
    """World metres to SVG units. ``low`` and ``high`` (2,) bound what is shown; rows run against the second axis."""

    low: FloatArray
    high: FloatArray

    @property
    def scale(self) -> float:
        return _WIDTH / float(self.high[0] - self.low[0])

    @property
    def height(self) -> float:
        return float(self.high[1] - self.low[1]) * self.scale

    def to_svg(self, points: FloatArray) -> FloatArray:
        """(N, 2) SVG points of (N, 2) map points."""
        return np.stack([points[:, 0] - self.low[0], self.high[1] - points[:, 1]], axis=1) * self.scale


def top_map(scene: Scene, trajectory: Trajectory | None = None, start: FloatArray | None = None) -> str:
    """SVG of the table from above, as the robot looks at it: x (away from it) upwards, y (its left) to the left.

    Footprints of the objects' oriented boxes with their numbers and labels, the edge of the workspace where it
    is near, and the waypoints' path. ``start`` (3,) is the tool's position before, metres.
    """
    return _map(scene, trajectory, start, np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]), "top")


def side_map(scene: Scene, trajectory: Trajectory | None = None, start: FloatArray | None = None) -> str:
    """SVG from the robot's right side: x (away from it) to the right, z upwards, the table as a line."""
    return _map(scene, trajectory, start, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), "side")


def _map(
    scene: Scene, trajectory: Trajectory | None, start: FloatArray | None, axes: FloatArray, kind: str
) -> str:
    stops = np.array([w.xyz for w in trajectory or ()], dtype=np.float64).reshape(-1, 3)
    path = stops if start is None else np.vstack([np.asarray(start, dtype=np.float64)[None], stops])
    outlines = [_outline(thing) @ axes.T for thing in scene.objects]
    shown = [*outlines, stops @ axes.T]
    if kind == "side":
        shown.append(
            np.array([[outline[:, 0].mean(), scene.table_height] for outline in outlines]).reshape(-1, 2)
        )
    frame = _window(shown, scene, axes)
    parts = [_ground(scene, frame, axes, kind)]
    parts += [_footprint(k, thing, frame.to_svg(outlines[k])) for k, thing in enumerate(scene.objects)]
    dots: list[Rect] = []
    if len(stops):
        parts.append(_path(frame.to_svg(path @ axes.T), trajectory, start is not None))
        parts.append(_dots(frame.to_svg(stops @ axes.T), trajectory, dots))
    parts.append(_labels(scene, [frame.to_svg(o) for o in outlines], dots, frame))
    title = "The table from above" if kind == "top" else "The table from the side"
    return (
        f'<svg class="map" role="img" aria-label="{title}" xmlns="http://www.w3.org/2000/svg" '
        f'viewBox="0 0 {_WIDTH:.0f} {frame.height + 34:.1f}">'
        f'<title>{title}</title><svg width="{_WIDTH:.0f}" height="{frame.height:.1f}">{"".join(parts)}</svg>'
        f"{_scale_bar(frame)}{_compass(frame, kind)}</svg>"
    )


def _outline(thing: SceneObject) -> FloatArray:
    """Points (N, 3) on the object's hull: a ring at either end for round things, else the box's corners."""
    if thing.shape not in ("cylinder", "disc", "sphere"):
        return thing.corners()
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    if thing.shape == "sphere":
        upright = ring[:, [0, 2, 1]]
        side = ring[:, [2, 0, 1]]
        return transform_points(
            thing.world_from_object, 0.5 * np.vstack([ring, upright, side]) * thing.extents
        )
    up = np.array([0.0, 0.0, 1.0])
    ends = np.vstack([ring + up, ring - up])
    return transform_points(thing.world_from_object, 0.5 * ends * thing.extents)


def _window(shown: Sequence[FloatArray], scene: Scene, axes: FloatArray) -> _Frame:
    points = np.vstack([p for p in shown if len(p)] or [(axes @ scene.workspace.low)[None]])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        points = np.zeros((1, 2))
    low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    spare = np.maximum(0, _LEAST - (high - low)) / 2
    low, high = low - spare, high + spare
    # Neither a ribbon nor a tower: at most two and a half times as long one way as the other.
    spare = np.maximum(0, (high - low).max() / 2.5 - (high - low)) / 2
    return _Frame(low - spare, high + spare)


def _hull(points: FloatArray) -> list[tuple[float, float]]:
    """Convex hull of points (N, 2), in order (Andrew's monotone chain)."""
    ordered = sorted({(round(float(x), 2), round(float(y), 2)) for x, y in points})
    if len(ordered) < 3:
        return ordered

    def half(row: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        chain: list[tuple[float, float]] = []
        for p in row:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        return chain[:-1]

    return half(ordered) + half(ordered[::-1])


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _points(points: Sequence[tuple[float, float]] | FloatArray) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _ground(scene: Scene, frame: _Frame, axes: FloatArray, kind: str) -> str:
    height = frame.height
    parts = [f'<rect class="map-table" width="{_WIDTH:.0f}" height="{height:.1f}" rx="6"/>']
    if kind == "side":
        table = float(frame.to_svg(np.array([[0.0, scene.table_height]]))[0, 1])
        if table < height:
            parts[0] = f'<rect class="map-air" width="{_WIDTH:.0f}" height="{height:.1f}" rx="6"/>'
            parts.append(
                f'<rect class="map-table" y="{table:.1f}" width="{_WIDTH:.0f}" height="{height - table:.1f}"/>'
                f'<line class="map-top" x2="{_WIDTH:.0f}" y1="{table:.1f}" y2="{table:.1f}"/>'
            )
    for tick in _grid(frame, 0):
        x = (tick - float(frame.low[0])) * frame.scale
        parts.append(f'<line class="map-grid" x1="{x:.1f}" x2="{x:.1f}" y2="{height:.1f}"/>')
    for tick in _grid(frame, 1):
        y = (float(frame.high[1]) - tick) * frame.scale
        parts.append(f'<line class="map-grid" x2="{_WIDTH:.0f}" y1="{y:.1f}" y2="{y:.1f}"/>')
    box = np.stack([scene.workspace.low, scene.workspace.high]) @ axes.T
    corners = frame.to_svg(np.stack([box.min(axis=0), box.max(axis=0)]))
    if np.isfinite(corners).all():
        (x0, y1), (x1, y0) = corners
        for a, b in (((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)), ((x1, y1), (x0, y1)), ((x0, y1), (x0, y0))):
            clipped = _clip(a, b, height)
            if clipped:
                parts.append(
                    '<line class="map-edge" x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}"/>'.format(
                        *clipped
                    )
                )
    return "".join(parts)


def _clip(a: tuple[float, float], b: tuple[float, float], height: float) -> tuple[float, ...] | None:
    """A level or upright line inside the map, None when it lies outside."""
    xs, ys = np.clip([a[0], b[0]], 0, _WIDTH), np.clip([a[1], b[1]], 0, height)
    level = abs(a[1] - b[1]) < 1e-6
    if (level and not 0 < a[1] < height) or (not level and not 0 < a[0] < _WIDTH):
        return None
    return float(xs[0]), float(ys[0]), float(xs[1]), float(ys[1])


def _grid(frame: _Frame, axis: int, step: float = 0.1) -> FloatArray:
    low, high = float(frame.low[axis]), float(frame.high[axis])
    step = step if high - low < 2.5 else 1.0
    return np.arange(np.ceil(low / step), np.floor(high / step) + 0.5) * step


def _footprint(index: int, thing: SceneObject, outline: FloatArray) -> str:
    r, g, b = np.clip(np.nan_to_num(thing.rgb), 0, 1) * 255
    kind = "map-region" if thing.shape == "region" else "map-object"
    return (
        f'<polygon class="{kind}" points="{_points(_hull(outline))}" '
        f'style="fill:rgb({r:.0f},{g:.0f},{b:.0f});stroke:{css_colour(marker_colour(index))}">'
        f"<title>{escape(thing.label or thing.id)}</title></polygon>"
    )


def _path(points: FloatArray, trajectory: Trajectory | None, from_start: bool) -> str:
    waypoints = tuple(trajectory or ())
    openings = [1.0, *(w.gripper for w in waypoints)]
    parts = []
    for k, waypoint in enumerate(waypoints):
        row = k if from_start else k - 1
        if row < 0:
            continue
        kind = "map-open" if openings[k] > 0.5 else "map-closed"
        kind += " map-free" if waypoint.motion == "free" else ""
        (x1, y1), (x2, y2) = points[row], points[row + 1]
        ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
        parts.append(f'<line class="map-halo" {ends}/><line class="map-leg {kind}" {ends}/>')
    return "".join(parts)


def _dots(points: FloatArray, trajectory: Trajectory | None, taken: list[Rect]) -> str:
    clusters: list[list[int]] = []
    for k, point in enumerate(points):
        home = next((c for c in clusters if np.linalg.norm(points[c[0]] - point) < 15), None)
        if home is None:
            clusters.append([k])
        else:
            home.append(k)
    waypoints, parts = tuple(trajectory or ()), []
    for names in clusters:
        x, y = (float(v) for v in points[names[0]])
        text = "·".join(str(k) for k in names)
        half = 8.5 + 3.6 * max(0, len(text) - 2)
        kind = "map-dot-open" if waypoints[names[-1]].gripper > 0.5 else "map-dot-closed"
        stages = escape(" / ".join(dict.fromkeys(waypoints[k].stage for k in names)))
        parts.append(
            f'<g class="map-dot {kind}"><title>{stages}</title>'
            f'<rect x="{x - half:.1f}" y="{y - 8.5:.1f}" width="{2 * half:.1f}" height="17" rx="8.5"/>'
            f'<text x="{x:.1f}" y="{y + 4:.1f}">{text}</text></g>'
        )
        taken.append(Rect(x - half, y - 8.5, x + half, y + 8.5))
    return "".join(parts)


def _labels(scene: Scene, outlines: Sequence[FloatArray], dots: Sequence[Rect], frame: _Frame) -> str:
    bounds = Rect(6, 6, _WIDTH - 6, frame.height - 6)
    boxes = [Rect(*o.min(axis=0).tolist(), *o.max(axis=0).tolist()) for o in outlines]
    taken = [*dots, *boxes]
    parts = []
    for k, (thing, near) in enumerate(zip(scene.objects, boxes, strict=True)):
        text = shorten(thing.label or thing.id, 26)
        size = (7.8 * len(text) + 24, 18.0)
        others = [box for box in taken if box is not near]
        spot = place(near, size, others, bounds)
        taken.append(spot)
        cx, cy = near.centre
        if spot.overlap(around(cx, cy, max(near.x1 - cx, near.y1 - cy) + 12)) == 0:
            tip = (min(max(cx, spot.x0), spot.x1), min(max(cy, spot.y0), spot.y1))
            parts.append(
                f'<line class="map-leader" x1="{cx:.1f}" y1="{cy:.1f}" x2="{tip[0]:.1f}" y2="{tip[1]:.1f}"/>'
            )
        x, y = spot.x0, spot.y0
        parts.append(
            f'<g class="map-label"><rect x="{x:.1f}" y="{y + 1:.1f}" width="16" height="16" rx="4" '
            f'style="fill:{css_colour(marker_colour(k))}"/>'
            f'<text class="map-number" x="{x + 8:.1f}" y="{y + 13:.1f}">{k + 1}</text>'
            f'<text class="map-name" x="{x + 20:.1f}" y="{y + 13.5:.1f}">{escape(text)}</text></g>'
        )
    return "".join(parts)


def _scale_bar(frame: _Frame) -> str:
    length, name = (0.1, "100 mm") if frame.scale > 180 else (0.5, "500 mm")
    width, y = length * frame.scale, frame.height + 18
    return (
        f'<g class="map-scale"><path d="M1 {y - 4:.1f}v8m0-4h{width:.1f}m0-4v8"/>'
        f'<text x="{width + 9:.1f}" y="{y + 4:.1f}">{name}</text></g>'
    )


def _compass(frame: _Frame, kind: str) -> str:
    text = "↑ x, away from the robot · y ←" if kind == "top" else "x, away from the robot → · ↑ z"
    return f'<text class="map-compass" x="{_WIDTH - 1:.0f}" y="{frame.height + 22:.1f}">{text}</text>'
