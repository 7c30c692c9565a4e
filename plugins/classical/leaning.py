"""Flat things that lean: the lid of a box that stands open, a board against something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.solids import narrow_yaw
from gvla2_plugins.classical.things import THIN, Thing

THICKEST = 0.02  # metres: what is thicker is no plate
LEAST = 0.05  # metres: the shorter side of a plate that is believed to lean
STEEP, LEVEL = (
    0.05,
    0.97,
)  # upward share of the normal of a leaning plate: between an upright one and a lying one
LEAST_LEAN, MOST_LEAN = 0.03, 0.35  # radians: a box leans, and does not lie
SKEW = 0.02  # metres between a leaning side and that of the upright box about it
FLAT = 0.004  # metres: points of one side deviate by less from a plane
FACING = 0.85  # cosine of the angle between a side and that of the upright box, at least
FEWEST = 60  # points of a side that tells how it leans
STRAY = 2.0  # per cent of the points that need not lie in the plate, at each side


def leaning_plate(thing: Thing) -> Thing | None:
    """The thing as a plate that leans, where all its points lie in one; None otherwise.

    Its x axis is level, its y axis rises along the plate, its z axis is the plate's normal, upwards.
    """
    points = thing.points
    middle = np.median(points, axis=0)
    for _ in range(2):
        _, vectors = np.linalg.eigh(np.cov((points - points.mean(axis=0)).T))
        normal = vectors[:, 0]
        off = (thing.points - middle) @ normal
        points = thing.points[np.abs(off - np.median(off)) < THICKEST]
        if len(points) < 0.9 * len(thing.points):
            return None
    normal = normal * np.sign(normal[2] or 1.0)
    if not STEEP < normal[2] < LEVEL:
        return None
    level = np.array([-normal[1], normal[0], 0.0])
    level /= np.linalg.norm(level)
    axes = np.stack([level, np.cross(normal, level), normal], axis=1)
    low, high = np.percentile(points @ axes, [0.5, 99.5], axis=0)
    thin_low, thin_high = np.percentile(points @ normal, [STRAY, 100.0 - STRAY])
    low[2], high[2] = thin_low, thin_high
    lengths = high - low
    if lengths[2] > THICKEST or lengths[:2].min() < LEAST or not _straight(points @ axes[:, :2], lengths[:2]):
        return None
    extents: FloatArray = np.maximum(lengths, 2 * THIN)
    return replace(
        thing,
        kind="box",
        centre=axes @ (0.5 * (low + high)),
        yaw=float(np.arctan2(level[1], level[0])),
        extents=extents,
        agreement=float(
            (np.abs(points @ normal - 0.5 * (low[2] + high[2])) < 0.5 * extents[2] + 0.002).mean()
        ),
        floating=True,
        turn=axes,
    )


def lean_of(block: Thing) -> FloatArray:
    """(3,) the upward axis of a box that may lean a little: square to the sides that were seen of it."""
    local, half = block.local(block.points), 0.5 * block.extents
    faces: list[tuple[float, FloatArray]] = []
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            own = sign * local[:, axis] - half[axis]
            others = np.abs(local[:, [1 - axis, 2]]) < half[[1 - axis, 2]] * [0.8, 0.85]
            face = block.points[(np.abs(own) < SKEW) & others.all(axis=1)]
            if len(face) < FEWEST:
                continue
            spread, vectors = np.linalg.eigh(np.cov(face.T))
            deviation, normal = float(np.sqrt(max(0.0, spread[0]))), vectors[:, 0]
            if deviation < FLAT and abs(normal @ block.pose[:3, axis]) > FACING:
                faces.append((deviation, normal))
    up = np.array([0.0, 0.0, 1.0])
    if not faces:
        return up
    # Two upright sides leave one axis; one side alone leaves the steepest. The flattest is trusted first.
    square = np.stack([normal for _, normal in sorted(faces, key=lambda f: f[0])])
    first = square[0]
    across = square[np.argmin(np.abs(square @ first))]
    crossed = np.cross(first, across)
    axis3 = crossed if np.linalg.norm(crossed) > 0.8 else up - (up @ first) * first
    axis3 = axis3 / np.linalg.norm(axis3)
    axis3 = axis3 * np.sign(axis3[2] or 1.0)
    return axis3 if MOST_LEAN > np.arccos(min(1.0, float(axis3[2]))) > LEAST_LEAN else up


def leant(thing: Thing, axis: FloatArray) -> Thing:
    """The upright thing with its z axis along ``axis`` (3,) and its box about its points."""
    if axis[2] > 1.0 - 1e-9:
        return thing
    x = thing.pose[:3, 0]
    x = x - (x @ axis) * axis
    x = x / np.linalg.norm(x)
    turn = np.stack([x, np.cross(axis, x), axis], axis=1)
    low, high = np.percentile(thing.points @ turn, [0.5, 99.5], axis=0)
    if not thing.floating and thing.on < 0:
        # The foot is hidden or in shade: the box goes down to the table.
        low[2] = min(low[2], float(turn[:, 2] @ np.array([*thing.centre[:2], 0.0])))
    extents: FloatArray = np.maximum(high - low, THIN)
    return replace(thing, centre=turn @ (0.5 * (low + high)), extents=extents, turn=turn)


def _straight(flat: FloatArray, lengths: FloatArray) -> bool:
    """Whether the plate's sides are level and rising: the smallest rectangle about it is not turned."""
    yaw, _, smallest = narrow_yaw(flat, trim=0.5)
    turned = min(yaw, 0.5 * np.pi - yaw)
    return bool(turned < 0.15 or smallest.prod() > 0.9 * lengths.prod())
