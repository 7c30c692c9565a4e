"""One thing on the table: a solid and the pixels that show it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray, rigid
from gvla2_plugins.classical.frames import IntArray

Kind = Literal["box", "cylinder", "sphere", "region", "other"]
"""A region is paint on the table."""

THIN = 2e-3  # metres: nothing is taken to be flatter


@dataclass(frozen=True)
class Thing:
    """One solid on the table, in the table's frame (z = 0 is its top), metres.

    ``members`` (N,) its pixels in the list; ``points`` (N, 3); ``centre``, ``yaw``, ``extents`` its upright box;
    ``agreement`` in [0, 1] how well the solid explains the points; ``hollow``: one sees into it; ``floating``: free
    space was seen under it; ``guessed``: how deep it is was not seen; ``lowest`` height of its seen points;
    ``group`` tells which things were one before a split by height; ``on`` is the index of the thing that carries
    it, -1 for the table; ``part_of`` that of the thing that it is known to be a part of, and ``noun`` what it is known
    to be, "" where only its shape tells; ``textured``: paint tells nothing of its parts; ``opening`` its inner width,
    0 where it is closed; ``turn`` (3, 3) the axes of a thing that leans, in place of ``yaw``.
    """

    kind: Kind
    members: IntArray = field(repr=False)
    points: FloatArray = field(repr=False)
    centre: FloatArray
    yaw: float
    extents: FloatArray
    agreement: float
    hollow: bool = False
    floating: bool = False
    guessed: bool = False
    lowest: float = 0.0
    group: int = -1
    on: int = -1
    part_of: int = -1
    noun: str = ""
    opening: float = 0.0
    textured: bool = False
    turn: FloatArray | None = None

    @property
    def spans(self) -> FloatArray:
        """(3,) side lengths of the upright box about it that is turned by its yaw."""
        if self.turn is None:
            return self.extents
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        upright = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(np.abs(upright @ self.turn) @ self.extents)

    @property
    def top(self) -> float:
        """Height of its highest point."""
        return float(self.centre[2] + 0.5 * self.spans[2])

    @property
    def bottom(self) -> float:
        """Height of its lowest point."""
        return float(self.centre[2] - 0.5 * self.spans[2])

    @property
    def pose(self) -> FloatArray:
        """(4, 4) table_from_thing."""
        if self.turn is not None:
            return rigid(self.turn, self.centre)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return rigid([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], self.centre)

    def resting_at(self, height: float) -> Thing:
        """The same thing with its lower face at ``height``; its top stays."""
        span = max(THIN, self.top - height)
        centre = np.array([*self.centre[:2], self.top - 0.5 * span])
        return replace(self, centre=centre, extents=np.array([*self.extents[:2], span]))

    def covers(self, xy: FloatArray, margin: float = 0.0) -> NDArray[np.bool_]:
        """(N,) bool: points (N, 2) over its footprint, grown by ``margin`` metres."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = (xy - self.centre[:2]) @ np.array([[c, -s], [s, c]])
        if self.kind in ("cylinder", "sphere"):
            return np.asarray(np.linalg.norm(local, axis=1) <= 0.5 * self.extents[0] + margin)
        return np.asarray((np.abs(local) <= 0.5 * self.spans[:2] + margin).all(axis=1))

    def grid(self, *shares: FloatArray) -> FloatArray:
        """(N, 3) all points at so many of its extents from its centre, along each of its three axes."""
        steps = np.stack(np.meshgrid(*shares, indexing="ij"), axis=-1).reshape(-1, 3)
        return np.asarray(self.centre + (steps * self.extents) @ self.pose[:3, :3].T)

    def local(self, points: FloatArray) -> FloatArray:
        """(N, 3) points (N, 3) along its own axes, from its centre."""
        pose = self.pose
        return np.asarray((points - pose[:3, 3]) @ pose[:3, :3])


def upright_rectangle(yaw: float, width: float, depth: float) -> tuple[float, float, float]:
    """Yaw, width, depth of the same rectangle named the same way each time."""
    if min(width, depth) > 0.9 * max(width, depth):
        quarter = np.round(yaw / (0.5 * np.pi))
        yaw -= quarter * 0.5 * np.pi
        if int(quarter) % 2:
            width, depth = depth, width
        return float(yaw), float(width), float(depth)
    if depth > width:
        yaw, width, depth = yaw + 0.5 * np.pi, depth, width
    return float((yaw + 0.5 * np.pi) % np.pi - 0.5 * np.pi), float(width), float(depth)
