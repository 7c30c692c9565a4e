"""The animation of an execution: a bounded number of frames, then one GIF."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

Frame = NDArray[np.uint8]

FRAME_LIMIT = 80
SIDE = 320
MAX_BYTES = 2_000_000


class FrameReel:
    """Collects frames while a robot moves and never holds more than ``limit`` of them, plus the newest.

    When there are more, every second frame is dropped and from then on half as many are taken, so the kept ones are
    always evenly spread over the whole motion. Frames larger than ``side`` pixels are reduced immediately.
    """

    def __init__(self, limit: int = FRAME_LIMIT, side: int = SIDE) -> None:
        self.limit, self.side = limit, side
        self._kept: list[Frame] = []
        self._newest: Frame | None = None
        self._stride, self._count = 1, 0

    def add(self, image: NDArray[np.uint8]) -> None:
        """Take an RGB frame (H, W, 3) uint8; a copy is kept, or nothing."""
        if max(image.shape[:2]) <= self.side:
            self._newest = image.copy()
        else:
            picture = Image.fromarray(np.ascontiguousarray(image))
            picture.thumbnail((self.side, self.side), Image.Resampling.BILINEAR, reducing_gap=None)
            self._newest = np.array(picture)
        if self._count % self._stride == 0:
            self._kept.append(self._newest)
            if len(self._kept) > self.limit:
                self._kept = self._kept[::2]
                self._stride *= 2
        self._count += 1

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Evenly spread frames; the last is always the newest one."""
        if self._newest is None or self._kept[-1] is self._newest:
            return tuple(self._kept)
        return (*self._kept[: self.limit - 1], self._newest)


def gif(frames: Sequence[Frame], fps: float = 12.0, max_bytes: int = MAX_BYTES, rest: float = 1.2) -> bytes:
    """A looping GIF of RGB frames (H, W, 3) uint8, all of one size; the last frame rests ``rest`` seconds.

    One palette serves all frames. When the file would exceed ``max_bytes`` colours are reduced first, then frames, then
    size. Raises :class:`ValueError` without frames.
    """
    if not frames:
        raise ValueError("An animation needs at least one frame.")
    pictures = [Image.fromarray(np.ascontiguousarray(frame)) for frame in frames]
    data = b""
    for colours, every, shrink in ((256, 1, 1.0), (96, 1, 1.0), (64, 2, 1.0), (64, 2, 0.7), (32, 4, 0.5)):
        chosen = pictures[:-1][::every] + pictures[-1:]
        data = _encode(chosen, colours, shrink, fps / every, rest)
        if len(data) <= max_bytes:
            break
    return data


def _encode(pictures: Sequence[Image.Image], colours: int, shrink: float, fps: float, rest: float) -> bytes:
    if shrink < 1:
        pictures = [ImageOps.scale(picture, shrink, Image.Resampling.LANCZOS) for picture in pictures]
    palette = _palette(pictures, colours)
    # No dithering: still pixels stay the same from frame to frame, and only what moves is stored.
    indexed = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    step = max(20, round(100 / fps) * 10)  # GIF counts hundredths of a second; browsers slow down below two
    durations = [step] * (len(indexed) - 1) + [step + round(rest * 100) * 10]
    stream = io.BytesIO()
    indexed[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=indexed[1:],
        duration=durations,
        loop=0,
        optimize=True,
        disposal=1,
    )
    return stream.getvalue()


def _palette(pictures: Sequence[Image.Image], colours: int) -> Image.Image:
    """The palette that suits frames from the whole motion."""
    chosen = np.unique(np.linspace(0, len(pictures) - 1, 9).round().astype(int))
    mosaic = Image.fromarray(np.concatenate([np.asarray(pictures[k]) for k in chosen]))
    return mosaic.quantize(colors=colours, method=Image.Quantize.MEDIANCUT)
