"""All pictures of a reconstruction's page, as files' bytes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Renderer
from gvla2.record.animation import gif
from gvla2.record.drawing import png
from gvla2.record.reconstruction.maps import (
    masked_picture,
    painted_by_support,
    part_of,
    photograph,
    residual_picture,
    support_picture,
)
from gvla2.record.reconstruction.measures import Measures, on_white
from gvla2.record.reconstruction.turntable import SECONDS_A_TURN, ring, side_by_side, turn

MOST_VIEWS = 12
"""Most views on the page, spread over all."""
TURNTABLE_SIZE = 288
TITLES = ("first reconstruction", "refined")


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


def turntables(
    views: Views,
    measures: Measures,
    renderer: Renderer,
    frames: int,
) -> tuple[bytes, bytes]:
    """GIF files of one turn starting at the first view's side: the refined object alone, and both side by side."""
    points = np.concatenate([measures.before.gaussians.centres, measures.after.gaussians.centres])
    cameras = ring(points.astype(np.float64), frames, TURNTABLE_SIZE, views[0].camera.position)
    before, after = (turn(end.gaussians, cameras, renderer) for end in (measures.before, measures.after))
    fps = frames / SECONDS_A_TURN
    return gif(after, fps, rest=0.0), gif(side_by_side(before, after, TITLES), fps, rest=0.0)
