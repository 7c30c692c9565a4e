"""Targets of an optimisation: the object's part of each view, on white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gvla2.geometry.camera import Camera
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import Floats

MARGIN = 8
"""Pixels of background kept around a mask, so that spill-over is penalised."""
LEAST_PIXELS = 16
"""A mask with fewer pixels counts as empty."""

_WHITE_ENOUGH = 0.98


@dataclass(frozen=True)
class Target:
    """One view cut to the object: ``image`` (h, w, 3) and ``mask`` (h, w) float32 in [0, 1].

    ``image`` has white where the mask is 0. ``weight`` (h, w) is 0 where the view is uninformative (the robot hides the
    object); it is divided by the mask's pixels, so that views of any size count alike.
    """

    camera: Camera
    image: Floats
    mask: Floats
    weight: Floats


def targets(views: Views) -> tuple[Target, ...]:
    """One target per view; views without a mask, or with an empty one, give none."""
    return tuple(_cut(view, view.mask) for view in views if view.mask is not None and _shows(view.mask))


def _shows(mask: Floats) -> bool:
    return int((mask > 0.5).sum()) >= LEAST_PIXELS


def _cut(view: View, mask: Floats) -> Target:
    rows, columns = np.flatnonzero((mask > 0).any(axis=1)), np.flatnonzero((mask > 0).any(axis=0))
    top, left = max(rows[0] - MARGIN, 0), max(columns[0] - MARGIN, 0)
    bottom = min(rows[-1] + 1 + MARGIN, view.camera.height)
    right = min(columns[-1] + 1 + MARGIN, view.camera.width)
    window = np.s_[top:bottom, left:right]
    K = view.camera.K.copy()
    K[0, 2] -= left
    K[1, 2] -= top
    camera = Camera(K, view.camera.world_from_camera, int(right - left), int(bottom - top), view.name)
    part = np.clip(mask[window], 0.0, 1.0).astype(np.float32)
    image = view.image[window].astype(np.float32) / np.float32(255)
    outside = part == 0
    if not outside.any() or image[outside].mean() < _WHITE_ENOUGH:
        # Pixels on the rim hold some of an unknown background: white takes its place as far as the mask says.
        image = image * part[..., None] + (1 - part[..., None])
    weight = np.full(part.shape, 1 / float((mask > 0.5).sum()), dtype=np.float32)
    if view.robot_mask is not None:
        weight[view.robot_mask[window]] = 0.0
    return Target(camera, np.ascontiguousarray(image), np.ascontiguousarray(part), weight)
