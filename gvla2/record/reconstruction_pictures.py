"""All pictures of a reconstruction's page, as files' bytes: its views, and the object seen from all around."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion

from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.geometry.transform import FloatArray, look_along
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import Renderer
from gvla2.reconstruction.support import mask_of
from gvla2.record.drawing import Colour, Rect, contact_sheet, enlarged, part_about, png
from gvla2.record.motion import Frame, gif
from gvla2.record.reconstruction_measures import Floats, Measures, on_white

MISSED: Colour = (230, 97, 1)
EXCESS: Colour = (44, 96, 214)
AGREED: Colour = (186, 198, 208)
CONTOUR: Colour = (255, 45, 120)
PAPER = 246
SUPPORT_SCALE: tuple[tuple[float, Colour], ...] = (
    (0.0, (165, 15, 55)),
    (0.45, (236, 112, 50)),
    (0.75, (250, 206, 110)),
    (0.95, (120, 178, 190)),
    (1.0, (40, 98, 128)),
)
"""Colour of s(p); red and orange are points that most views place outside the object."""


def scale_css() -> str:
    """The support's colours as a CSS gradient, from 0 to 1."""
    stops = ", ".join(f"rgb{colour} {100 * at:g}%" for at, colour in SUPPORT_SCALE)
    return f"linear-gradient(90deg, {stops})"


def support_colours(support: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) in [0, 1]."""
    at = [stop for stop, _ in SUPPORT_SCALE]
    colours = np.array([colour for _, colour in SUPPORT_SCALE]) / 255.0
    return np.stack([np.interp(support, at, colours[:, c]) for c in range(3)], axis=1)


def painted_by_support(gaussians: Gaussians, support: NDArray[np.float64]) -> Gaussians:
    """The Gaussians in the colours of their support, independent of direction."""
    sh_dc = ((support_colours(support) - 0.5) / SH_C0).astype(np.float32)
    return replace(gaussians, sh_dc=sh_dc, sh_rest=None)


def part_of(view: View, silhouettes: Iterable[NDArray[np.bool_]]) -> Rect:
    """A square part of the image with the mask, the silhouettes and some margin; at least 48 pixels."""
    shown = np.argwhere(np.any([mask_of(view) > 0.5, *silhouettes], axis=0))[:, ::-1]
    corners = np.concatenate([shown, shown + 1]).astype(np.float64)
    return part_about(corners, (view.camera.width, view.camera.height), grow=1.24, least=48)


def photograph(image: NDArray[np.uint8] | Floats, box: Rect, width: int = 360) -> Image.Image:
    """A part of a picture (uint8, or float in [0, 1]), enlarged smoothly by an integer factor to about ``width``."""
    array = image if image.dtype == np.uint8 else np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
    return enlarged(Image.fromarray(np.ascontiguousarray(array)), width, box)


def masked_picture(view: View, width: int = 512) -> Image.Image:
    """The whole view, washed out outside the mask, with the mask's edge drawn."""
    box = Rect(0, 0, view.camera.width, view.camera.height)
    picture = np.asarray(photograph(view.image, box, width), dtype=np.float32)
    inside = _inside(view, box, width)
    faded = 0.35 * picture + 0.65 * 235
    return _with_edge(np.where(inside[..., None], picture, faded), inside)


def support_picture(painted: Floats, alpha: Floats, view: View, box: Rect, width: int = 360) -> Image.Image:
    """The points in the colours of their support, as this camera sees them, and the mask's edge."""
    shown = painted + (1 - alpha[..., None]) * (np.float32(PAPER / 255) - np.float32(1.0))
    picture = np.asarray(photograph(shown, box, width), dtype=np.float32)
    return _with_edge(picture, _inside(view, box, width), thin=True)


def residual_picture(silhouette: NDArray[np.bool_], view: View, box: Rect, width: int = 360) -> Image.Image:
    """Silhouette against mask, pixel by pixel: agreed grey, missed orange, excess blue."""
    mask = mask_of(view) > 0.5
    grey = view.image.astype(np.float32).mean(axis=-1, keepdims=True)
    picture = np.full(view.image.shape, PAPER, dtype=np.float32)
    picture[mask & silhouette] = (0.78 * np.array(AGREED) + 0.22 * grey)[mask & silhouette]
    picture[mask & ~silhouette] = MISSED
    picture[silhouette & ~mask] = EXCESS
    return enlarged(Image.fromarray(picture.astype(np.uint8)), width, box, Image.Resampling.NEAREST)


def _inside(view: View, box: Rect, width: int) -> NDArray[np.bool_]:
    """The mask's pixels in the enlarged part."""
    mask = Image.fromarray(mask_of(view))
    return np.asarray(enlarged(mask, width, box, Image.Resampling.BILINEAR)) > 0.5


def _with_edge(picture: NDArray[np.float32], inside: NDArray[np.bool_], thin: bool = False) -> Image.Image:
    """The picture with a mask's edge drawn on it, about two pixels wide, or one."""
    outside = inside if thin else binary_dilation(inside)
    edge = outside ^ binary_erosion(inside, border_value=1)
    drawn = picture.astype(np.uint8)
    drawn[edge] = CONTOUR
    return Image.fromarray(drawn)


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
