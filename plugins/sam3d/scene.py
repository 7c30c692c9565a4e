"""Views written in the layouts that SAM3D and related programs read."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import GeometryError
from gvla2.geometry.gso_views import write_gso
from gvla2.geometry.plain_views import write_plain
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_whole

OBJECT = "object"


def write_scene(scene: Path, views: Views) -> Path:
    """Write the views below ``scene`` and return the picture of the view that shows most of the object.

    Raises :class:`GeometryError` when no view has a mask.
    """
    masked = tuple(v for v in views if _shown(v).any())
    if not masked:
        raise GeometryError("No view has a mask that shows the object, and external programs need one.")
    shown = Views(masked)
    write_plain(scene, shown)
    write_gso(scene / "render_mvs_25" / "model", shown)
    (scene / OBJECT).mkdir(exist_ok=True)
    for number, view in enumerate(shown):
        write_whole(scene / OBJECT / f"{number}.png", _cut_out(view))
    single = scene / "single"
    single.mkdir(exist_ok=True)
    best = max(shown, key=lambda view: float(_shown(view).mean()))
    write_whole(single / "image.png", _png(best.image))
    write_whole(single / "0.png", _cut_out(best))
    return single / "image.png"


def _shown(view: View) -> NDArray[np.bool_]:
    """(H, W) the pixels of the view's mask; none without a mask."""
    return np.zeros(view.image.shape[:2], dtype=bool) if view.mask is None else view.mask > 0.5


def _cut_out(view: View) -> bytes:
    """RGBA whose alpha is the mask, hard: readers take any alpha above 0 for the object."""
    alpha = np.where(_shown(view), 255, 0).astype(np.uint8)
    return _png(np.dstack([view.image, alpha]))


def _png(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(array).save(stream, "PNG")
    return stream.getvalue()
