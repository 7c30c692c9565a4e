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
        view = replace(view, image=tinted(view.image, noise.colour, noise.exposure, rig, rng))
    if noise.offset_m or noise.turn_deg:
        view = replace(view, camera=misplaced(view.camera, noise.offset_m, noise.turn_deg, rig))
    return view


def _measured(
    view: View, true: NDArray[np.float32], noise: DepthNoise, scale: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """(H, W) depth, metres."""
    depth: NDArray[np.float64] = true.astype(np.float64)
    lost = np.zeros(depth.shape, dtype=bool)
    if noise.grazing:
        lost |= grazed(view.camera, depth, noise.grazing, rng)
    if noise.dark:
        lost |= darkened(view.image, noise.dark, rng)
    if noise.flying:
        depth = flying(depth, noise.flying, rng)
    depth = scale * depth + rng.standard_normal(depth.shape) * (noise.sigma_m + noise.sigma_rel * depth)
    if noise.quantum_m:
        depth = noise.quantum_m * np.rint(depth / noise.quantum_m)
    lost |= rng.random(depth.shape) < noise.dropout
    with np.errstate(invalid="ignore"):
        lost |= depth <= 0
    return np.where(lost, np.nan, depth).astype(np.float32)


def flying(depth: FloatArray, share: float, rng: np.random.Generator) -> FloatArray:
    """Depth (H, W) in which a ``share`` of the pixels at steps lie somewhere between both sides."""
    with np.errstate(invalid="ignore"):
        padded = np.pad(depth, 1, mode="edge")
        around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
        near, far = np.fmin.reduce(around), np.fmax.reduce(around)
        steps = np.isfinite(depth) & (far - near > JUMP)
    struck = steps & (rng.random(depth.shape) < share)
    mixed = near + (far - near) * rng.random(depth.shape)
    return np.where(struck, mixed, depth)


def grazed(camera: Camera, depth: FloatArray, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(H, W) bool: pixels lost because of a grazing view of their surface."""
    points = camera.backproject(depth)
    across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normal = np.cross(across, down)
    ray = points - camera.position
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.abs(np.einsum("ijk,ijk->ij", normal, ray))
        cosine = cosine / (np.linalg.norm(normal, axis=-1) * np.linalg.norm(ray, axis=-1))
        angle = np.arccos(np.clip(cosine, 0.0, 1.0))
        lost = np.clip((angle - GRAZING_FROM) / (GRAZING_ALL - GRAZING_FROM), 0.0, 1.0) * share
    return np.asarray(rng.random(depth.shape) < np.nan_to_num(lost))


def darkened(image: NDArray[np.uint8], share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(H, W) bool: pixels lost because their surface reflects too little light."""
    bright = image.mean(axis=-1) / 255.0
    lost = np.clip((DARK_FROM - bright) / (DARK_FROM - DARK_ALL), 0.0, 1.0) * share
    return np.asarray(rng.random(bright.shape) < lost)


def tinted(
    image: NDArray[np.uint8],
    noise: float,
    exposure: float,
    rig: np.random.Generator,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """The image with independent ``noise`` (deviation, in [0, 1]), and this camera's constant gain.

    ``exposure`` is the gains' deviation over cameras; the three channels differ by a third of it.
    """
    gain = (1.0 + exposure * rig.standard_normal()) * (1.0 + exposure / 3.0 * rig.standard_normal(3))
    grains = 255.0 * noise * rng.standard_normal(image.shape)
    return np.asarray(np.clip(np.rint(image * np.clip(gain, 0.3, 3.0) + grains), 0, 255), dtype=np.uint8)


def misplaced(camera: Camera, offset: float, turn: float, rig: np.random.Generator) -> Camera:
    """The camera with a calibration error: off by ``offset`` metres and ``turn`` degrees in random directions."""
    way, axis = (v / np.linalg.norm(v) for v in rig.standard_normal((2, 3)))
    wrong = rigid(Rotation.from_rotvec(np.deg2rad(turn) * axis).as_matrix(), offset * way)
    return Camera(camera.K, camera.world_from_camera @ wrong, camera.width, camera.height, camera.name)
