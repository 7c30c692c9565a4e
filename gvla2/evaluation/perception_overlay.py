"""A picture of perception against truth: true outlines and perceived boxes."""

from __future__ import annotations

import numpy as np
from PIL import Image
from skimage.measure import find_contours

from gvla2.evaluation.perception_scoring import SceneScore
from gvla2.evaluation.perception_truth import BoolArray, measured
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene, SceneObject
from gvla2.record.drawing import Canvas, Colour, Rect, marker_colour, png

FOUND: Colour = (255, 255, 255)
MISSED: Colour = (255, 40, 40)

_EDGES = tuple((a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4))


def overlay_sheet(observation: Observation, result: SceneScore, scene: Scene, width: int = 440) -> bytes:
    """All views in a row as PNG: the outline of each true object (white when found, red when missed), the box of each
    perceived object in a colour of its own with its label.
    """
    pictures = []
    masks = _split(observation, result)
    for view, shown in zip(observation.views, masks, strict=True):
        canvas = Canvas(view.image, width, _part(view, shown))
        for mask, one in zip(shown, result.truths, strict=True):
            for contour in find_contours(np.pad(mask, 1).astype(float), 0.5):  # type: ignore[no-untyped-call]
                canvas.line(contour[:, ::-1] - 0.5, FOUND if one.match.found else MISSED, width=1.5, halo=0.5)
        for index, obj in enumerate(scene.objects):
            _draw(canvas, view.camera, obj, index)
        pictures.append(np.asarray(canvas.picture()))
    return png(Image.fromarray(np.hstack(pictures)).quantize(128))


def _split(observation: Observation, result: SceneScore) -> list[list[BoolArray]]:
    """For each view the mask (H, W) of every obj."""
    views, start = [], 0
    for ok in measured(observation):
        count = int(ok.sum())
        masks = []
        for one in result.truths:
            mask = np.zeros(ok.shape, dtype=bool)
            mask[ok] = one.true.whole[start : start + count]
            masks.append(mask)
        views.append(masks)
        start += count
    return views


def _part(view: View, masks: list[BoolArray]) -> Rect:
    """The square part of the picture with the objects in it, a third of the picture at least."""
    height, width = view.image.shape[:2]
    side = min(height, width)
    rows, columns = np.nonzero(np.any(masks, axis=0)) if masks else (np.zeros(0), np.zeros(0))
    if not len(rows):
        return Rect(0, 0, side, side)
    low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
    part = float(np.clip(1.25 * (high - low).max(), side / 3, side))
    x, y = np.clip((low + high) / 2 - part / 2, 0, [width - part, height - part])
    return Rect(float(x), float(y), float(x) + part, float(y) + part)


def _draw(canvas: Canvas, camera: Camera, obj: SceneObject, index: int) -> None:
    uv, depth = camera.project(obj.corners())
    if (depth <= 0).any():
        return
    colour = marker_colour(index)
    for a, b in _EDGES:
        canvas.line(uv[[a, b]], colour, width=1.5, halo=0.5)
    middle = camera.project(obj.centre[None])[0][0]
    if camera.inside(middle):
        near = Rect(*map(float, uv.min(axis=0)), *map(float, uv.max(axis=0)))
        canvas.label(obj.label, near, colour)
