"""The object seen from all around, before and after: animations of one turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image

from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.transform import FloatArray, look_along
from gvla2.reconstruction.contracts import Renderer
from gvla2.record.animation import Frame
from gvla2.record.sheet import contact_sheet

FIELD_OF_VIEW = np.deg2rad(30.0)
ELEVATION = np.deg2rad(22.0)
SECONDS_A_TURN = 4.0


def ring(points: FloatArray, count: int, size: int, first: FloatArray | None = None) -> tuple[Camera, ...]:
    """Cameras that circle points (N, 3) once, world z upwards, with all of them in the picture.

    The circle starts on the side of the position ``first`` (3,).
    """
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    centre, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    away = 1.02 * max(radius, 1e-6) / np.sin(0.5 * FIELD_OF_VIEW)
    begin = 0.0 if first is None else float(np.arctan2(*(first - centre)[1::-1]))
    turns, flat = begin + 2 * np.pi * np.arange(count) / count, np.cos(ELEVATION)
    offsets = [away * np.array([flat * np.cos(t), flat * np.sin(t), np.sin(ELEVATION)]) for t in turns]
    return tuple(
        Camera.from_fov(FIELD_OF_VIEW, look_along(centre + offset, -offset), size, size, f"turn {k}")
        for k, offset in enumerate(offsets)
    )


def turn(gaussians: Gaussians, cameras: Sequence[Camera], renderer: Renderer) -> list[Frame]:
    """Frames (H, W, 3) uint8 on white."""
    images = (renderer.render(gaussians, camera)[0] for camera in cameras)
    return [np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8) for image in images]


def side_by_side(left: Sequence[Frame], right: Sequence[Frame], titles: tuple[str, str]) -> list[Frame]:
    """Frames of two turns in one picture, so that they stay in step, with a title over each."""
    pairs = zip(map(Image.fromarray, left), map(Image.fromarray, right), strict=True)
    return [np.asarray(contact_sheet(list(zip(titles, pair, strict=True)))) for pair in pairs]
