"""A canvas for annotating camera pictures, and sheets of several pictures."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from gvla2.geometry.transform import FloatArray
from gvla2.io.foreign import png_bytes
from gvla2.record.text import one_line


class Rect(NamedTuple):
    """A rectangle in picture coordinates, y downwards; pixels or SVG units."""

    x0: float
    y0: float
    x1: float
    y1: float

    def overlaps(self, other: Rect) -> bool:
        """Whether they share an area."""
        return self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1


def part_about(points: FloatArray, size: tuple[int, int], grow: float, least: float) -> Rect:
    """The square part of a picture of ``size`` (width, height) with the points (N, 2), in whole pixels.

    Its side is ``grow`` times what the points need and at least ``least``, as far as the picture goes. Without points
    it is the whole picture.
    """
    whole = np.array(size)
    if not len(points):
        return Rect(0, 0, *size)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.minimum(np.ceil(max(least, grow * (high - low).max())), whole)
    start = np.clip((low + high - extent) // 2, 0, whole - extent)
    return Rect(*np.concatenate([start, start + extent]).tolist())


def place(near: Rect, size: tuple[float, float], taken: Sequence[Rect], bounds: Rect) -> Rect:
    """A place of a label of ``size`` (width, height) beside ``near`` and inside ``bounds``: the first that is free of
    ``taken`` above, below, right and left; above if none is.
    """
    width, height = size
    spots = []
    for x, y in (
        (0.5 * (near.x0 + near.x1 - width), near.y0 - height - GAP),
        (0.5 * (near.x0 + near.x1 - width), near.y1 + GAP),
        (near.x1 + GAP, 0.5 * (near.y0 + near.y1 - height)),
        (near.x0 - width - GAP, 0.5 * (near.y0 + near.y1 - height)),
    ):
        x = min(max(x, bounds.x0), max(bounds.x0, bounds.x1 - width))
        y = min(max(y, bounds.y0), max(bounds.y0, bounds.y1 - height))
        spots.append(Rect(x, y, x + width, y + height))
    return next((spot for spot in spots if not any(map(spot.overlaps, taken))), spots[0])


GAP = 4.0
"""Pixels between a label and what it names."""
Colour = tuple[int, int, int]
Point = tuple[float, float]
Points = Sequence[Point] | NDArray[np.float64]
"""Points (N, 2)."""

INK: Colour = (15, 20, 28)
PAPER: Colour = (255, 255, 255)
PALETTE: tuple[Colour, ...] = (
    (86, 180, 255),
    (255, 176, 46),
    (255, 110, 180),
    (90, 214, 120),
    (178, 140, 255),
    (46, 212, 200),
    (255, 122, 92),
    (206, 224, 70),
)
"""Marker colours, by the order of objects; readable on light and dark pictures inside a dark halo."""

_SMOOTH = 2  # lines are drawn this much larger, then reduced: Pillow draws jagged lines
_FAR = 1e5  # pixels: points projected further out than this would overflow the rasteriser


def marker_colour(index: int) -> Colour:
    """Colour of the object at this place in the scene, the same in every picture."""
    return PALETTE[index % len(PALETTE)]


def css_colour(colour: Colour) -> str:
    """``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def enlarged(
    picture: Image.Image,
    width: int,
    box: Rect | None = None,
    how: Image.Resampling = Image.Resampling.LANCZOS,
) -> Image.Image:
    """The picture, or its part ``box`` in whole pixels, enlarged by a whole factor to about ``width`` pixels."""
    part = box or Rect(0, 0, *picture.size)
    across, down = part.x1 - part.x0, part.y1 - part.y0
    scale = max(1, round(width / across))
    return picture.resize((int(across * scale), int(down * scale)), how, box=part)


font = ImageFont.load_default
"""Pillow's own typeface by its size, so that pictures look the same on every machine."""


class Canvas:
    """A camera picture (H, W, 3) uint8, enlarged to about ``width`` pixels: all of it by an integer factor, or
    ``part``.

    All coordinates are pixels of the camera's image; they are moved and enlarged here. Shapes share a layer, labels are
    above all shapes, in the order of the calls. Sizes (line widths, radii) are pixels of the result.
    """

    def __init__(self, image: NDArray[np.uint8], width: int = 512, part: Rect | None = None) -> None:
        height, given = image.shape[:2]
        self._part = part or Rect(0, 0, given, height)
        shown = self._part.x1 - self._part.x0
        self.scale = width / shown if part else float(max(1, round(width / given)))
        self.size = (round(shown * self.scale), round((self._part.y1 - self._part.y0) * self.scale))
        whole = Image.fromarray(np.ascontiguousarray(image))
        self._picture = whole.resize(self.size, Image.Resampling.LANCZOS, box=self._part)
        self._layer = Image.new("RGBA", (self.size[0] * _SMOOTH, self.size[1] * _SMOOTH), (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._layer)
        self._labels: list[tuple[str, Rect, Colour, str]] = []
        self._digits: list[tuple[str, Point]] = []

    def line(
        self,
        points: Points,
        colour: Colour,
        width: float = 2.0,
        halo: float = 1.5,
        alpha: int = 255,
    ) -> None:
        """A polyline with a dark halo."""
        path = self._path(points)
        if len(path) < 2:
            return
        strokes = [((*INK, min(alpha, 170)), width + 2 * halo)] if halo else []
        for ink, across in (*strokes, ((*colour, alpha), width)):
            self._draw.line(path, ink, round(across * _SMOOTH), joint="curve")

    def dot(self, at: Point, radius: float, fill: Colour, ring: Colour = INK, text: str = "") -> None:
        """A ringed dot with a short text in it."""
        for x, y in self._path([at]):
            r = radius * _SMOOTH
            half = r + 0.62 * r * max(0, len(text) - 2)
            box = (x - half, y - r, x + half, y + r)
            self._draw.rounded_rectangle(box, r, fill=(*fill, 255), outline=(*ring, 255), width=2 * _SMOOTH)
            if text:
                self._digits.append((text, (x / _SMOOTH, y / _SMOOTH)))

    def label(self, text: str, near: Rect, colour: Colour, badge: str = "") -> None:
        """A label beside ``near`` (image pixels), with a coloured ``badge`` before it."""
        self._labels.append((one_line(text, 34), self._moved(near), colour, badge))

    def picture(self) -> Image.Image:
        """The annotated picture, RGB."""
        smooth = self._layer.reduce(_SMOOTH)
        result = Image.alpha_composite(self._picture.convert("RGBA"), smooth)
        pen = ImageDraw.Draw(result, "RGBA")
        for text, at in self._digits:
            pen.text(at, text, fill=(*INK, 255), font=font(12), anchor="mm")
        taken: list[Rect] = []
        for text, near, colour, badge in self._labels:
            taken.append(self._write_label(pen, text, near, colour, badge, taken))
        return result.convert("RGB")

    def _write_label(
        self, pen: ImageDraw.ImageDraw, text: str, near: Rect, colour: Colour, badge: str, taken: list[Rect]
    ) -> Rect:
        face = font(14)
        chip = max(18.0, pen.textlength(badge, font=face) + 10) if badge else 0.0
        size = pen.textlength(text, font=face) + 12 + chip, 20.0
        spot = place(near, size, taken, Rect(4, 4, self.size[0] - 4, self.size[1] - 4))
        middle = 0.5 * (spot.y0 + spot.y1)
        pen.rounded_rectangle(spot, 5, fill=(*INK, 205), outline=(*colour, 255))
        if badge:
            pen.rounded_rectangle((spot.x0, spot.y0, spot.x0 + chip, spot.y1), 5, fill=(*colour, 255))
            pen.text((spot.x0 + chip / 2, middle), badge, fill=(*INK, 255), font=face, anchor="mm")
        pen.text((spot.x0 + chip + 6, middle), text, (*PAPER, 255), face, "lm")
        return spot

    def _moved(self, near: Rect) -> Rect:
        s, x, y = self.scale, self._part.x0, self._part.y0
        return Rect((near.x0 - x) * s, (near.y0 - y) * s, (near.x1 - x) * s, (near.y1 - y) * s)

    def _path(self, points: Points) -> list[Point]:
        """The points that are near enough to draw, on the layer."""
        given = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        near = given[(np.abs(given) < _FAR).all(axis=1)]  # NaN is not
        return [(x, y) for x, y in ((near - self._part[:2]) * self.scale * _SMOOTH).tolist()]


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
    return png_bytes(contact_sheet(tiles, columns)) if tiles else b""
