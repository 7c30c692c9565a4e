"""Noise of depth cameras, added to clean observations as :class:`DepthNoise` specifies.

Magnitudes and their sources (``depth_noise=realistic``):

* **holes on grazing surfaces**: structured light and stereo lose surfaces seen at more than about 70 degrees (Nguyen,
  Izadi and Lovell 2012, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking");
* **holes on dark surfaces**: little of the projected light comes back; data sheets state the range for reflectivities
  of 10 % and more, so darker surfaces are partly lost;
* **flying pixels**: at a step in depth a pixel sees both sides and measures something between (Sabov and Krueger 2008,
  "Identification and correction of flying pixels in range camera data");
* **bias that grows with range**: data sheets of consumer cameras allow 2 % of the range; after a factory calibration
  some tenths of a percent are usual, here 0.3 % (standard deviation over cameras), 4 mm at 1.3 m;
* **quantisation**: depth comes as whole millimetres (the usual unit of 16-bit depth pictures);
* **colour**: a few grey levels of noise per pixel, and exposure and white balance that differ by camera;
* **extrinsics**: a good hand-eye calibration is accurate to about 2 mm and 0.3 degrees.
"""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import Observation, View, Views
from gvla2.robot.options import DepthNoise

JUMP = 0.02
"""A step in depth between neighbouring pixels, metres."""

GRAZING_FROM, GRAZING_ALL = np.deg2rad(68.0), np.deg2rad(85.0)
"""Angles of view to the surface's normal: measurements are lost above the first, the full share above the second."""

DARK_FROM, DARK_ALL = 0.14, 0.05
"""The same for the brightness of a pixel, in [0, 1]: lost below the first, the full share below the second."""


def apply_noise(
    observation: Observation, noise: DepthNoise, rng: np.random.Generator, seed: int = 0
) -> Observation:
    """A copy of the observation with noise on every view; its other data are shared, not copied.

    NaN stays NaN, a depth pushed to zero or below becomes NaN, lost pixels become NaN. Robot masks stay: they come from
    the joints. ``rng`` draws the noise of each look; a camera's constant errors follow from ``seed`` and its name.
    """
    views = tuple(_disturb(view, noise, rng, seed) for view in observation.views)
    return replace(observation, views=Views(views))


def _disturb(view: View, noise: DepthNoise, rng: np.random.Generator, seed: int) -> View:
    rig = np.random.default_rng([seed, zlib.crc32(view.name.encode())])
    scale = 1.0 + noise.bias_rel * rig.standard_normal()
    if view.depth is not None:
        view = replace(view, depth=_measured(view, view.depth, noise, scale, rng))
    if noise.colour or noise.exposure:
        # A camera's gain; its three channels differ by a third of that.
        gain = (1.0 + noise.exposure * rig.standard_normal()) * (
            1.0 + noise.exposure / 3.0 * rig.standard_normal(3)
        )
        grains = 255.0 * noise.colour * rng.standard_normal(view.image.shape)
        image = np.clip(np.rint(view.image * np.clip(gain, 0.3, 3.0) + grains), 0, 255)
        view = replace(view, image=image.astype(np.uint8))
    if noise.offset_m or noise.turn_deg:
        way, axis = (v / np.linalg.norm(v) for v in rig.standard_normal((2, 3)))
        turn = Rotation.from_rotvec(np.deg2rad(noise.turn_deg) * axis).as_matrix()
        pose = view.camera.world_from_camera @ rigid(turn, noise.offset_m * way)
        view = replace(view, camera=replace(view.camera, world_from_camera=pose))
    return view


def _measured(
    view: View, true: NDArray[np.float32], noise: DepthNoise, scale: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """(H, W) depth, metres."""
    depth: NDArray[np.float64] = true.astype(np.float64)
    lost = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore", divide="ignore"):
        if noise.grazing:
            share = noise.grazing * _between(_slant(view.camera, depth), GRAZING_FROM, GRAZING_ALL)
            lost |= rng.random(depth.shape) < np.nan_to_num(share)
        if noise.dark:
            share = noise.dark * _between(view.image.mean(axis=-1) / 255.0, DARK_FROM, DARK_ALL)
            lost |= rng.random(depth.shape) < share
        if noise.flying:
            depth = _flying(depth, noise.flying, rng)
        depth = scale * depth + rng.standard_normal(depth.shape) * (noise.sigma_m + noise.sigma_rel * depth)
        if noise.quantum_m:
            depth = noise.quantum_m * np.rint(depth / noise.quantum_m)
        lost |= rng.random(depth.shape) < noise.dropout
        lost |= depth <= 0
    return np.where(lost, np.nan, depth).astype(np.float32)


def _between(value: FloatArray, none: float, whole: float) -> FloatArray:
    """0 at ``none``, 1 at ``whole``, linear between."""
    return np.clip((value - none) / (whole - none), 0.0, 1.0)


def _slant(camera: Camera, depth: FloatArray) -> FloatArray:
    """(H, W) angle between the view and each pixel's surface normal, radians."""
    points = camera.backproject(depth)
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    ray = points - camera.position
    cosine = np.abs(np.einsum("ijk,ijk->ij", normal, ray))
    cosine = cosine / (np.linalg.norm(normal, axis=-1) * np.linalg.norm(ray, axis=-1))
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _flying(depth: FloatArray, share: float, rng: np.random.Generator) -> FloatArray:
    """Depth (H, W) in which a ``share`` of the pixels at steps lie somewhere between both sides."""
    padded = np.pad(depth, 1, mode="edge")
    around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    near, far = np.fmin.reduce(around), np.fmax.reduce(around)
    struck = np.isfinite(depth) & (far - near > JUMP) & (rng.random(depth.shape) < share)
    return np.where(struck, near + (far - near) * rng.random(depth.shape), depth)
