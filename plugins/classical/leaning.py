"""Things that lean, by the smallest box about their points: the lid of a box that stands open, a board, a block."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from trimesh.bounds import oriented_bounds

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.solids import evenly
from gvla2_plugins.classical.things import THIN, Thing

THICKEST = 0.02  # metres: what is thicker is no plate
LEAST = 0.05  # metres: the shorter side of a plate that is believed to lean
STEEP, LEVEL = 0.05, 0.97  # upward share of its normal: between that of an upright plate and of a lying one
TURNED = 0.15  # radians that its lower edge may rise
LEAST_LEAN, MOST_LEAN = 0.03, 0.35  # radians: a block leans, and does not lie
MOST_POINTS = 1000  # that the smallest box is made about


def leaning_plate(thing: Thing) -> Thing | None:
    """The thing as a plate that leans, where its points lie in one; None otherwise.

    Its x axis is level, its y axis rises along the plate, its z axis is the plate's normal, upwards.
    """
    axes = _axes_of_box(thing.points)
    lengths = np.ptp(np.percentile(thing.points @ axes, [2.0, 98.0], axis=0), axis=0)
    thin = int(np.argmin(lengths))
    normal = axes[:, thin] * np.sign(axes[2, thin] or 1.0)
    if lengths[thin] > THICKEST or np.delete(lengths, thin).min() < LEAST or not STEEP < normal[2] < LEVEL:
        return None
    if np.abs(np.delete(axes, thin, axis=1)[2]).min() > np.sin(TURNED):
        return None
    flat, normal = _plane(thing.points, normal)
    level = np.array([-normal[1], normal[0], 0.0]) / np.hypot(*normal[:2])
    leaning = _along(thing, np.stack([level, np.cross(normal, level), normal], axis=1), flat)
    extents, agreement = np.maximum(leaning.extents, 2 * THIN), len(flat) / len(thing.points)
    yaw = float(np.arctan2(level[1], level[0]))
    return replace(leaning, kind="box", yaw=yaw, extents=extents, agreement=agreement, floating=True)


def lean_of(block: Thing) -> FloatArray:
    """(3,) the upward axis of a box that may lean a little."""
    axes = _axes_of_box(block.points)
    upward = axes[:, np.argmax(np.abs(axes[2]))]
    upward = upward * np.sign(upward[2])
    leans = LEAST_LEAN < np.arccos(min(1.0, float(upward[2]))) < MOST_LEAN
    return upward if leans else np.array([0.0, 0.0, 1.0])


def leant(thing: Thing, axis: FloatArray) -> Thing:
    """The upright thing with its z axis along ``axis`` (3,) and its box about its points."""
    if axis[2] > 1.0 - 1e-9:
        return thing
    x = thing.pose[:3, 0]
    x = x - (x @ axis) * axis
    x = x / np.linalg.norm(x)
    leaning = _along(thing, np.stack([x, np.cross(axis, x), axis], axis=1))
    if thing.floating or thing.on >= 0:
        return leaning
    # The foot is hidden or in shade: the box goes down to the table.
    down = max(0.0, float(axis @ (leaning.centre - [*thing.centre[:2], 0.0]) - 0.5 * leaning.extents[2]))
    extents = np.append(leaning.extents[:2], leaning.extents[2] + down)
    return replace(leaning, centre=leaning.centre - 0.5 * down * axis, extents=extents)


def _axes_of_box(points: FloatArray) -> FloatArray:
    """(3, 3) unit axes, as columns, of the smallest box about points (N, 3)."""
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


def _along(thing: Thing, turn: FloatArray, points: FloatArray | None = None) -> Thing:
    """The thing with the axes ``turn`` (3, 3) and its box about its points, or some of them."""
    low, high = np.percentile((thing.points if points is None else points) @ turn, [0.5, 99.5], axis=0)
    return replace(thing, centre=turn @ (0.5 * (low + high)), extents=np.maximum(high - low, THIN), turn=turn)
