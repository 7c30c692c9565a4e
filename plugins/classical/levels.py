"""Objects that no single solid explains: split by height, or leaning, as the smallest box about their points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from trimesh.bounds import oriented_bounds

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.pixels import IntArray
from gvla2_plugins.classical.solids import THIN, SeenObject, evenly, narrow_yaw

THICKEST = 0.02  # metres: what is thicker is no plate
LEAST = 0.05  # metres: the shorter side of a plate that is believed to lean
STEEP, LEVEL = 0.05, 0.97  # upward share of its normal: between that of an upright plate and of a lying one
TURNED = 0.15  # radians that its lower edge may rise
LEAST_LEAN, MOST_LEAN = 0.03, 0.35  # radians: a block leans, and does not lie
MOST_POINTS = 1000  # that the smallest box is made about
FINEST = 1e-6  # metres: points that spread less across a line lie on it


def leaning_plate(obj: SeenObject) -> SeenObject | None:
    """The object as a plate that leans, where its points lie in one; None otherwise.

    Its x axis is level, its y axis rises along the plate, its z axis is the plate's normal, upwards.
    """
    axes = _axes_of_box(obj.points)
    lengths = np.ptp(np.percentile(obj.points @ axes, [2.0, 98.0], axis=0), axis=0)
    thin = int(np.argmin(lengths))
    normal = axes[:, thin] * np.sign(axes[2, thin] or 1.0)
    if lengths[thin] > THICKEST or np.delete(lengths, thin).min() < LEAST or not STEEP < normal[2] < LEVEL:
        return None
    if np.abs(np.delete(axes, thin, axis=1)[2]).min() > np.sin(TURNED):
        return None
    flat, normal = _plane(obj.points, normal)
    level = np.array([-normal[1], normal[0], 0.0]) / np.hypot(*normal[:2])
    leaning = _along(obj, np.stack([level, np.cross(normal, level), normal], axis=1), flat)
    extents, agreement = np.maximum(leaning.extents, 2 * THIN), len(flat) / len(obj.points)
    yaw = float(np.arctan2(level[1], level[0]))
    return replace(leaning, kind="box", yaw=yaw, extents=extents, agreement=agreement, floating=True)


def lean_of(block: SeenObject) -> FloatArray:
    """(3,) the upward axis of a box that may lean a little."""
    axes = _axes_of_box(block.points)
    upward = axes[:, np.argmax(np.abs(axes[2]))]
    upward = upward * np.sign(upward[2])
    leans = LEAST_LEAN < np.arccos(min(1.0, float(upward[2]))) < MOST_LEAN
    return upward if leans else np.array([0.0, 0.0, 1.0])


def leant(obj: SeenObject, axis: FloatArray) -> SeenObject:
    """The upright object with its z axis along ``axis`` (3,) and its box about its points."""
    if axis[2] > 1.0 - 1e-9:
        return obj
    x = obj.pose[:3, 0]
    x = x - (x @ axis) * axis
    x = x / np.linalg.norm(x)
    leaning = _along(obj, np.stack([x, np.cross(axis, x), axis], axis=1))
    if obj.floating or obj.on >= 0:
        return leaning
    # The foot is hidden or in shade: the box goes down to the table.
    down = max(0.0, float(axis @ (leaning.centre - [*obj.centre[:2], 0.0]) - 0.5 * leaning.extents[2]))
    extents = np.append(leaning.extents[:2], leaning.extents[2] + down)
    return replace(leaning, centre=leaning.centre - 0.5 * down * axis, extents=extents)


def _axes_of_box(points: FloatArray) -> FloatArray:
    """(3, 3) unit axes, as columns, of the smallest box about points (N, 3), N > 0; any about a line of them."""
    off = points - points.mean(axis=0)
    spread, axes = np.linalg.eigh(off.T @ off / len(off))
    if spread[1] < FINEST**2:
        return axes
    box_from_here, _ = oriented_bounds(evenly(points, MOST_POINTS))
    return np.asarray(box_from_here[:3, :3].T, dtype=np.float64)


def _plane(points: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Those of points (N, 3) that lie in one plane, and its unit normal; what flies off an edge is not among them."""
    off = points @ normal
    for _ in range(3):
        far = np.abs(off - np.median(off))
        flat = points[far <= max(THIN, 2.0 * float(np.median(far)))]
        fitted = np.linalg.eigh(np.cov(flat.T))[1][:, 0]
        off = points @ fitted
    return flat, fitted * np.sign(fitted @ normal)


def _along(obj: SeenObject, turn: FloatArray, points: FloatArray | None = None) -> SeenObject:
    """The object with the axes ``turn`` (3, 3) and its box about its points, or some of them."""
    low, high = np.percentile((obj.points if points is None else points) @ turn, [0.5, 99.5], axis=0)
    return replace(obj, centre=turn @ (0.5 * (low + high)), extents=np.maximum(high - low, THIN), turn=turn)


SLICE = 0.010  # metres
LIKE = 0.45  # intersection over union of the outlines of two neighbouring slices of one part


def split_by_height(points: FloatArray, least: int) -> list[IntArray]:
    """Indices of each part's points (N, 3), lowest part first; one entry when nothing separates parts.

    The points are cut into slices; where the outline changes much from one to the next, a part ends. A part of fewer
    than ``least`` points goes to the one below.
    """
    yaw, _, _ = narrow_yaw(points[:, :2])
    c, s = np.cos(yaw), np.sin(yaw)
    xy = points[:, :2] @ np.array([[c, -s], [s, c]])
    slices = np.floor(points[:, 2] / SLICE + 0.5).astype(np.int64)
    parts: list[IntArray] = []
    before: FloatArray | None = None
    for level in np.unique(slices):
        inside = np.nonzero(slices == level)[0]
        outline = np.percentile(xy[inside], [1.0, 99.0], axis=0) if len(inside) >= 3 else before
        if before is None or (_overlap(before, outline) < LIKE and len(parts[-1]) >= least):  # type: ignore[arg-type]
            parts.append(inside)
        else:
            parts[-1] = np.concatenate([parts[-1], inside])
        before = outline
    if len(parts) > 1 and len(parts[-1]) < least:
        parts[-2:] = [np.concatenate(parts[-2:])]
    return parts


def _overlap(a: FloatArray, b: FloatArray) -> float:
    """Intersection over union of two rectangles, (2, 2): lowest corner, highest corner."""
    sides = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
    shared = float(np.maximum(sides, 0.0).prod())
    return shared / max(1e-12, float((a[1] - a[0]).prod() + (b[1] - b[0]).prod()) - shared)
