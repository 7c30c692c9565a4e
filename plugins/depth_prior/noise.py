"""Depth of simulated sensors and networks: errors added to an exact depth map.

Sources of the defaults. VGGT (Wang et al., CVPR 2025, tables 2 and 3): the global scale is free, camera poses are right
to about a degree, point maps to about a per cent of the scene. Monocular networks (Ranftl et al., TPAMI 2022; Yang et
al., Depth Anything V2, 2024): depth up to a scale and shift of each picture, 4 to 8 per cent absolute relative error
after both are fitted, most of it smooth. Users report that depth is inconsistent between views, scale changes with
direction, and confidence is right only on average (facebookresearch/vggt, discussions 98, 208, 430, 436).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from gvla2_plugins.depth_prior import LearnedNoise

FloatArray = NDArray[np.float64]


def learned(
    depth: FloatArray, poses: FloatArray, noise: LearnedNoise, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Depth (S, H, W), confidence (S, H, W) in (0, 1] and poses (S, 4, 4), None when they have no error.

    ``depth`` is exact, NaN where nothing is; ``poses`` are world_from_camera. The draws do not depend on which parts
    are enabled, so that a sweep of one part keeps the others.
    """
    whole = np.exp(rng.uniform(-1, 1) * np.log1p(noise.global_scale))
    found, sure = np.full_like(depth, np.nan), np.zeros_like(depth)
    for s, exact in enumerate(depth):
        scale, shift, turn, tilt = rng.uniform(-1, 1, 4)
        smooth = _field(rng.normal(size=exact.shape), noise.correlation * exact.shape[1])
        doubt = _field(rng.normal(size=exact.shape), noise.correlation * exact.shape[1])
        patches = _patches(exact.shape, noise.outliers, rng)
        known = np.isfinite(exact)
        if not known.any():
            continue
        middle = float(np.median(exact[known]))
        made = _blurred(exact, noise.edge_blur)
        made = made * (1 + noise.view_scale * scale) + noise.view_shift * shift * middle
        made *= 1 + noise.slope * tilt * _ramp(known, np.pi * turn)
        made *= 1 + noise.low_frequency * smooth + noise.outlier_size * patches
        off = np.abs(made / exact / np.median((made / exact)[known]) - 1)
        typical = max(float(np.median(off[known])), 1e-6)
        truthful = np.log(1 / (1 + off / typical))
        log_certainty = (1 - noise.confidence) * truthful + noise.confidence * (0.7 * doubt - 0.7)
        found[s] = whole * made
        sure[s] = np.where(known, np.clip(np.exp(log_certainty), 1e-3, 1.0), 0.0)
    if noise.global_scale == noise.pose_degrees == noise.pose_shift == 0:
        return found, sure, None
    return found, sure, _moved(poses, whole, noise, rng)


def sensor(
    depth: FloatArray, sigma: float, relative: float, dropout: float, rng: np.random.Generator
) -> FloatArray:
    """Depth with independent errors of standard deviation ``sigma`` + ``relative`` x depth, metres, and holes."""
    noisy = depth + (sigma + relative * depth) * rng.normal(size=depth.shape)
    noisy[rng.random(depth.shape) < dropout] = np.nan
    return np.asarray(np.where(noisy > 0, noisy, np.nan))


def _field(white: FloatArray, sigma: float) -> FloatArray:
    """A smooth random field of unit variance."""
    field = gaussian_filter(white, sigma, mode="wrap")
    return np.asarray(field / max(float(field.std()), 1e-12))


def _blurred(depth: FloatArray, sigma: float) -> FloatArray:
    """Depth with a network's soft edges: blended with the background, a wall at the object's far side."""
    known = np.isfinite(depth)
    if sigma <= 0:
        return depth.copy()
    wall = float(np.nanmax(depth))
    soft = gaussian_filter(np.where(known, depth, wall), sigma)
    return np.where(known, soft, np.nan)


def _ramp(known: NDArray[np.bool_], angle: float) -> FloatArray:
    """A ramp from -1 to 1 across the object along a direction, 0 at its middle."""
    rows, columns = np.nonzero(known)
    y, x = np.mgrid[: known.shape[0], : known.shape[1]]
    along = (x - columns.mean()) * np.cos(angle) + (y - rows.mean()) * np.sin(angle)
    return np.asarray(along / max(float(np.abs(along[known]).max()), 1.0))


def _patches(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> FloatArray:
    """Round patches that cover about ``share`` of a picture, each of one value in [-1, 1]; 0 elsewhere."""
    height, width = shape
    radius = 0.04 * width
    y, x = np.mgrid[:height, :width]
    made = np.zeros(shape)
    for _ in range(round(share * height * width / (np.pi * radius**2))):
        row, column = rng.uniform(0, height), rng.uniform(0, width)
        made[(x - column) ** 2 + (y - row) ** 2 < radius**2] = rng.uniform(-1, 1)
    return made


def _moved(poses: FloatArray, whole: float, noise: LearnedNoise, rng: np.random.Generator) -> FloatArray:
    """The poses in a world of different scale and orientation, each with its own error."""
    world = np.eye(4)
    world[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    moved = np.array(poses)
    for pose in moved:
        axis = rng.normal(size=3)
        angle = np.radians(noise.pose_degrees) * rng.normal()
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        far = float(np.linalg.norm(pose[:3, 3]))
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] += noise.pose_shift * far * rng.normal(size=3) / np.sqrt(3)
        pose[:3, 3] *= whole
    return np.asarray(world @ moved)
