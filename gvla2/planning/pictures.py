"""A camera's picture for a vision model: bounded in size, optionally with a grid that helps to read coordinates."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image, ImageDraw

from gvla2.geometry.views import View

LINES = 10
"""The grid's cells across and down; each line is labelled with its coordinate."""


def shown(view: View, longest: int, *, grid: bool = False, scale: float = 1.0) -> bytes:
    """The view's image as PNG with its longer side at most ``longest`` pixels; shares of the picture stay the same.

    With ``grid``, thin lines every tenth are labelled with their coordinates, up to ``scale``.
    """
    image = Image.fromarray(np.asarray(view.image))
    image.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    if grid:
        pen = ImageDraw.Draw(image, "RGBA")
        for k in range(1, LINES):
            x, y = image.width * k / LINES, image.height * k / LINES
            pen.line([(x, 0), (x, image.height)], fill=(255, 255, 255, 90))
            pen.line([(0, y), (image.width, y)], fill=(255, 255, 255, 90))
            text = f"{scale * k / LINES:g}"
            pen.text((x + 2, 1), text, fill=(255, 255, 0, 255))
            pen.text((1, y + 1), text, fill=(255, 255, 0, 255))
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()
