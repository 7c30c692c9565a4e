"""All pictures of a reconstruction's page, as files' bytes: its views, and the object seen from all around."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, look_along
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import Renderer
from gvla2.reconstruction.support import mask_of
from gvla2.record.drawing import Colour, Rect, contact_sheet, enlarged, part_about, png
from gvla2.record.motion import encoded
from gvla2.record.reconstruction_measures import Floats, Measures, on_white

MISSED: Colour = (230, 97, 1)
EXCESS: Colour = (44, 96, 214)
AGREED: Colour = (186, 198, 208)
PAPER = 246


def part_of(view: View, silhouettes: Iterable[NDArray[np.bool_]]) -> Rect:
    """A square part of the image with the mask, the silhouettes and some margin; at least 48 pixels."""
    shown = np.argwhere(np.any([mask_of(view) > 0.5, *silhouettes], axis=0))[:, ::-1]
    corners = np.concatenate([shown, shown + 1]).astype(np.float64)
    return part_about(corners, (view.camera.width, view.camera.height), grow=1.24, least=48)


def photograph(image: NDArray[np.uint8] | Floats, box: Rect, width: int = 360) -> Image.Image:
    """A part of a picture (uint8, or float in [0, 1]), enlarged smoothly by an integer factor to about ``width``."""
    return enlarged(Image.fromarray(np.ascontiguousarray(as_bytes(image))), width, box)


def as_bytes(image: NDArray[np.uint8] | Floats) -> NDArray[np.uint8]:
    """The picture as uint8, also from float in [0, 1]."""
    whole = image if image.dtype == np.uint8 else np.rint(255 * np.clip(image, 0, 1))
    return whole.astype(np.uint8)


def residual_picture(silhouette: NDArray[np.bool_], view: View, box: Rect, width: int = 360) -> Image.Image:
    """Silhouette against mask, pixel by pixel: agreed grey, missed orange, excess blue."""
    mask = mask_of(view) > 0.5
    grey = view.image.astype(np.float32).mean(axis=-1, keepdims=True)
    picture = np.full(view.image.shape, PAPER, dtype=np.float32)
    picture[mask & silhouette] = (0.78 * np.array(AGREED) + 0.22 * grey)[mask & silhouette]
    picture[mask & ~silhouette] = MISSED
    picture[silhouette & ~mask] = EXCESS
    return enlarged(Image.fromarray(picture.astype(np.uint8)), width, box, Image.Resampling.NEAREST)


MOST_VIEWS = 12
"""Maximum number of views on the page, spread over all."""
TURNTABLE_SIZE = 288
SECONDS_A_TURN = 4.0
FIELD_OF_VIEW, ELEVATION = np.deg2rad(30.0), np.deg2rad(22.0)


@dataclass(frozen=True)
class ViewPictures:
    """The part of one input view with the object, as PNG files; pairs are (before, after).

    ``index`` is the view's place among the inputs.
    """

    index: int
    name: str
    photo: bytes
    renders: list[bytes]
    residuals: list[bytes]


@dataclass
class ReconstructionPictures:
    """The page's pictures; empty if not made. ``turntable`` is an MP4 film."""

    views: tuple[ViewPictures, ...] = ()
    turntable: bytes = b""


def shown_views(count: int) -> list[int]:
    """The views that the page shows."""
    return sorted({int(k) for k in np.linspace(0, count - 1, min(count, MOST_VIEWS)).round()})


def view_pictures(views: Views, measures: Measures) -> tuple[ViewPictures, ...]:
    """The pictures of the shown views."""
    ends = (measures.before, measures.after)
    made = []
    for k in shown_views(len(views)):
        view, fits = views[k], [end.views[k] for end in ends]
        box = part_of(view, [fit.silhouette for fit in fits])
        shown = ViewPictures(
            k,
            view.name,
            photo=png(photograph(on_white(view), box)),
            renders=[png(photograph(fit.image, box)) for fit in fits],
            residuals=[png(residual_picture(fit.silhouette, view, box)) for fit in fits],
        )
        made.append(shown)
    return tuple(made)


def turntable(views: Views, measures: Measures, renderer: Renderer, frames: int) -> bytes:
    """An MP4 film of one turn that starts at the first view's side: first and refined object side by side."""
    ends = (measures.before.gaussians, measures.after.gaussians)
    points = np.concatenate([end.centres for end in ends]).astype(np.float64)
    turn = []
    for camera in ring(points, frames, TURNTABLE_SIZE, views[0].camera.position):
        pair = [as_bytes(renderer.render(end, camera)[0]) for end in ends]
        titled = zip(("first reconstruction", "refined"), map(Image.fromarray, pair), strict=True)
        turn.append(np.asarray(contact_sheet(list(titled))))
    return encoded(turn, frames / SECONDS_A_TURN)


def ring(points: FloatArray, count: int, size: int, first: FloatArray) -> tuple[Camera, ...]:
    """Cameras that circle points (N, 3) once, world z upwards, with all of them in the picture.

    The circle starts on the side of the position ``first`` (3,).
    """
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    centre, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    away = 1.02 * max(radius, 1e-6) / np.sin(0.5 * FIELD_OF_VIEW)
    begin = np.arctan2(*(first - centre)[1::-1])
    turns, flat = begin + 2 * np.pi * np.arange(count) / count, np.cos(ELEVATION)
    offsets = [away * np.array([flat * np.cos(t), flat * np.sin(t), np.sin(ELEVATION)]) for t in turns]
    return tuple(
        Camera.from_fov(FIELD_OF_VIEW, look_along(centre + offset, -offset), size, size, f"turn {k}")
        for k, offset in enumerate(offsets)
    )
