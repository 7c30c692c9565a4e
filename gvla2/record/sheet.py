"""Depth as colours, and several pictures on one sheet."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gvla2.record.drawing import INK, PAPER, Canvas, enlarged, font, png
from gvla2.record.placement import Rect
from gvla2.record.text import one_line

_UNKNOWN = (96, 100, 108)


def depth_picture(depth: NDArray[np.float32], width: int = 512) -> Image.Image:
    """Depth (H, W), metres, as colours: yellow near, violet far, grey where nothing was measured.

    The scale runs from the 1st to the 99th percentile of the measurements and is written into the picture.
    """
    known = np.isfinite(depth)
    low, high = (float(v) for v in np.percentile(depth[known], [1, 99])) if known.any() else (0.0, 1.0)
    nearness = np.clip((high - np.where(known, depth, low)) / max(high - low, 1e-6), 0, 1)
    colours = cv2.applyColorMap(np.rint(255 * nearness).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    picture = Image.fromarray(np.where(known[..., None], colours, _UNKNOWN).astype(np.uint8))
    canvas = Canvas(np.asarray(enlarged(picture, width, how=Image.Resampling.NEAREST)), width)
    below = Rect(0, canvas.size[1], 0, canvas.size[1])
    canvas.label(f"{low:.2f} to {high:.2f} m" if known.any() else "no depth measured", below, _UNKNOWN)
    return canvas.picture()


def contact_sheet(tiles: Sequence[tuple[str, Image.Image]], columns: int = 2, gap: int = 8) -> Image.Image:
    """Titled pictures in rows on a white sheet, all cells as large as the largest picture."""
    columns = max(1, min(columns, len(tiles)))
    width = max((tile.width for _, tile in tiles), default=1)
    height = max((tile.height for _, tile in tiles), default=1)
    rows = -(-len(tiles) // columns)
    title = 26
    cell_w, cell_h = width + gap, height + title + gap
    sheet = Image.new("RGB", (columns * cell_w + gap, max(1, rows) * cell_h + gap), PAPER)
    pen = ImageDraw.Draw(sheet)
    for k, (name, tile) in enumerate(tiles):
        x, y = gap + (k % columns) * cell_w, gap + (k // columns) * cell_h
        pen.text((x + 2, y + title / 2), one_line(name, 60), fill=INK, font=font(15), anchor="lm")
        sheet.paste(tile, (x, y + title))
    return sheet


def contact_sheet_of(files: Mapping[str, bytes], columns: int = 2) -> bytes:
    """The sheet of PNG files, titled by their names, as a PNG file; no bytes for none."""
    tiles = [(name, Image.open(io.BytesIO(data))) for name, data in files.items()]
    return png(contact_sheet(tiles, columns)) if tiles else b""
