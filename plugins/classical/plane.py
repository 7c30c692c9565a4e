"""The table: the widest nearly level plane under the workspace, by RANSAC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.errors import PerceptionError
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid
from gvla2.planning.scene import Box
from gvla2_plugins.classical.frames import Frame

HYPOTHESES = 96
SAMPLE = 2000
SETTLE = 25000
BELOW = 0.15  # metres under the workspace where the table is still looked for
LEAST_SHARE = 0.10  # of the points in the workspace: with fewer, no surface carries anything


@dataclass(frozen=True)
class Table:
    """``table_from_world`` (4, 4): table top at z = 0, z its normal, origin under the workspace's centre, x along
    world x; ``height`` world z there; ``noise`` robust deviation of its points from the plane; metres.
    """

    table_from_world: FloatArray
    height: float
    noise: float


def find_table(
    frames: Sequence[Frame], workspace: Box, tolerance: float, max_tilt: float, seed: int
) -> Table:
    """The table under ``workspace``, from frames in the world's frame.

    Raises :class:`PerceptionError` when too few points are there, or no level plane carries enough of them.
    """
    low = workspace.low - [0.0, 0.0, BELOW]
    points = np.concatenate([f.points[np.isfinite(f.depth)] for f in frames])
    points = points[((points >= low) & (points <= workspace.high)).all(axis=1)]
    if len(points) < 200:
        raise PerceptionError(
            f"Only {len(points)} of the measured points lie in the workspace {workspace.low} to {workspace.high}; "
            "a table top needs hundreds. Check the cameras' poses and the workspace."
        )
    rng = np.random.default_rng(seed)
    sample = points[:: max(1, len(points) // SAMPLE)]
    triples = sample[rng.integers(0, len(sample), (HYPOTHESES, 3))]  # (B, 3, 3)
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    level = np.abs(normals[:, 2]) >= np.cos(max_tilt) * length
    level &= length > 1e-4
    normals = normals[level] / length[level, None]
    normals *= np.sign(normals[:, 2:])
    # Level planes through single points stand in where no triple was level, as on a sparse, noisy table.
    normals = np.concatenate([normals, np.tile([0.0, 0.0, 1.0], (32, 1))])
    anchors = np.concatenate([triples[level, 0], sample[rng.integers(0, len(sample), 32)]])
    offsets = np.einsum("ij,ij->i", normals, anchors)
    counts = (np.abs(sample @ normals.T - offsets) < tolerance).sum(axis=0)
    best = int(np.argmax(counts))
    normal, offset = _settle(
        points[:: max(1, len(points) // SETTLE)], normals[best], float(offsets[best]), tolerance
    )
    residual = points @ normal - offset
    inliers = np.abs(residual) < tolerance
    if inliers.sum() < max(200, LEAST_SHARE * len(points)) or normal[2] < np.cos(max_tilt):
        raise PerceptionError(
            f"No level plane carries the workspace: the best holds {int(inliers.sum())} of {len(points)} points "
            f"and tilts by {np.degrees(np.arccos(min(1.0, normal[2]))):.0f} degrees."
        )
    noise = 1.4826 * float(np.median(np.abs(residual[inliers])))
    x = np.cross([0.0, 1.0, 0.0], normal)
    x /= np.linalg.norm(x)
    middle = 0.5 * (workspace.low + workspace.high)
    height = float((offset - normal[:2] @ middle[:2]) / normal[2])
    world_from_table = rigid(np.stack([x, np.cross(normal, x), normal], axis=1), [*middle[:2], height])
    return Table(invert_rigid(world_from_table), height, noise)


def _settle(
    points: FloatArray, normal: FloatArray, offset: float, tolerance: float
) -> tuple[FloatArray, float]:
    """Least squares over the plane's own points, twice with a narrowing band."""
    for band in (tolerance, 0.7 * tolerance, 0.7 * tolerance):
        near = points[np.abs(points @ normal - offset) < band]
        if len(near) < 3:
            break
        centre = near.mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((near - centre).T))
        normal = vectors[:, 0] * np.sign(vectors[2, 0] or 1.0)
        offset = float(normal @ centre)
    return normal, offset
