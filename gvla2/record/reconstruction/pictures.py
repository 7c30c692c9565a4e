"""All pictures of a reconstruction's page, as files' bytes: its views, and the object seen from all around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, look_along
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Renderer
from gvla2.record.animation import Frame, gif
from gvla2.record.drawing import contact_sheet, png
from gvla2.record.reconstruction.maps import (
    masked_picture,
    painted_by_support,
    part_of,
    photograph,
    residual_picture,
    support_picture,
)
from gvla2.record.reconstruction.measures import Measures, on_white

MOST_VIEWS = 12
"""Most views on the page, spread over all."""
TURNTABLE_SIZE = 288
SECONDS_A_TURN = 4.0
FIELD_OF_VIEW, ELEVATION = np.deg2rad(30.0), np.deg2rad(22.0)


@dataclass(frozen=True)
class ViewPictures:
    """One input view's pictures as PNG files; pairs are (before, after).

    ``index`` is the view's place among the inputs. ``masked`` is the whole view; the others show the part with the
    object.
    """

    index: int
    name: str
    masked: bytes
    photo: bytes
    renders: list[bytes]
    supports: list[bytes]
    residuals: list[bytes]


@dataclass
class ReconstructionPictures:
    """The page's pictures; empty if not made. ``hero`` and ``turntable`` are GIF files."""

    views: tuple[ViewPictures, ...] = ()
    hero: bytes = b""
    turntable: bytes = b""


def shown_views(count: int) -> list[int]:
    """The views that the page shows."""
    return sorted({int(k) for k in np.linspace(0, count - 1, min(count, MOST_VIEWS)).round()})


def view_pictures(views: Views, measures: Measures, renderer: Renderer) -> tuple[ViewPictures, ...]:
    """The pictures of the shown views."""
    ends = (measures.before, measures.after)
    painted = [painted_by_support(end.gaussians, end.support) for end in ends]
    made = []
    for k in shown_views(len(views)):
        view, fits = views[k], [end.views[k] for end in ends]
        box = part_of(view, [fit.silhouette for fit in fits])
        supports = [support_picture(*renderer.render(end, view.camera), view, box) for end in painted]
        shown = ViewPictures(
            k,
            view.name,
            masked=png(masked_picture(view)),
            photo=png(photograph(on_white(view), box)),
            renders=[png(photograph(fit.image, box)) for fit in fits],
            supports=list(map(png, supports)),
            residuals=[png(residual_picture(fit.silhouette, view, box)) for fit in fits],
        )
        made.append(shown)
    return tuple(made)


def turntables(views: Views, measures: Measures, renderer: Renderer, frames: int) -> tuple[bytes, bytes]:
    """GIF files of one turn starting at the first view's side: the refined object alone, and both side by side."""
    ends = (measures.before.gaussians, measures.after.gaussians)
    points = np.concatenate([end.centres for end in ends]).astype(np.float64)
    turns: list[list[Frame]] = [[], []]
    for camera in ring(points, frames, TURNTABLE_SIZE, views[0].camera.position):
        for end, turn in zip(ends, turns, strict=True):
            image = renderer.render(end, camera)[0]
            turn.append(np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8))
    fps = frames / SECONDS_A_TURN
    return gif(turns[1], fps, rest=0.0), gif(list(map(side_by_side, *turns)), fps, rest=0.0)


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


def side_by_side(before: Frame, after: Frame) -> Frame:
    """Both in one picture with a title over each, so that they stay in step."""
    titled = (("first reconstruction", Image.fromarray(before)), ("refined", Image.fromarray(after)))
    return np.asarray(contact_sheet(titled))
