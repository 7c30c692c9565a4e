"""The motion of an episode in full: a film of every frame, and the arm's measured state at each of them.

The film needs ``imageio-ffmpeg`` (extra ``[export]``); without it only the states are stored. `gvla2 export lerobot`
makes training data sets from both.
"""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from gvla2.io.files import write_bytes
from gvla2.robot.backend import Moment

FILM, STATES = "episode.mp4", "motion.npz"
DEFAULT_FPS = 5.0
SMALLEST = 16
"""Least side of a film in pixels: encoders refuse smaller ones."""
AHEAD = 30
"""Frames that may wait for the encoder."""


class Motion:
    """Writes the film while the robot moves, in a thread of its own: an encoder takes 0.3 s to start.

    :meth:`finish` closes it and writes the states.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._moments: list[Moment] = []
        self._writer: Generator[None, bytes | None, None] | None = None
        self._first: NDArray[np.uint8] | None = None  # waits for the second, whose time gives the rate
        self._frames = 0
        self._studio = ThreadPoolExecutor(1, "film")
        self._awaited: deque[Future[None]] = deque()

    def moment(self, moment: Moment) -> None:
        """The state at the next frame."""
        self._moments.append(moment)

    def frame(self, image: NDArray[np.uint8]) -> None:
        """A frame (H, W, 3) uint8, all of one size; sides are cropped to even numbers, as players require."""
        if getattr(image, "ndim", 0) != 3 or min(image.shape[:2]) < SMALLEST:
            return  # not a film frame; the recorder reports what was wrong with it
        even = np.ascontiguousarray(image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2])
        self._frames += 1
        if self._first is None:
            self._first = even
            return
        if self._frames == 2:
            self._later(self._open, self._first, self.fps)
        self._later(self._send, even)

    @property
    def fps(self) -> float:
        """Frames a second, from the first two moments."""
        if len(self._moments) < 2:
            return DEFAULT_FPS
        apart = self._moments[1].time - self._moments[0].time
        return round(1.0 / apart, 2) if apart > 0 else DEFAULT_FPS

    def finish(self) -> None:
        """Close the film, and write the states where each frame has one; safe to call twice."""
        try:
            while self._awaited:
                self._awaited.popleft().result()
        finally:
            self._studio.shutdown(cancel_futures=True)
            self._awaited.clear()
            if self._writer is not None:
                self._writer.close()
                self._writer = None
        if self._moments and len(self._moments) == self._frames:
            stream = io.BytesIO()
            np.savez_compressed(
                stream,
                time=np.array([m.time for m in self._moments]),
                joints=np.array([m.joints for m in self._moments]),
                gripper_width=np.array([m.gripper_width for m in self._moments]),
                fps=np.array(self.fps),
            )
            write_bytes(self._folder / STATES, stream.getvalue())

    def _later(self, act: Callable[..., None], *inputs: Any) -> None:
        self._awaited.append(self._studio.submit(act, *inputs))
        while self._awaited and (self._awaited[0].done() or len(self._awaited) > AHEAD):
            self._awaited.popleft().result()

    def _send(self, image: NDArray[np.uint8]) -> None:
        if self._writer is not None:
            self._writer.send(image.tobytes())

    def _open(self, first: NDArray[np.uint8], fps: float) -> None:
        try:
            import imageio_ffmpeg
        except ImportError:
            return
        made: Any = imageio_ffmpeg.write_frames(
            str(self._folder / FILM),
            (first.shape[1], first.shape[0]),
            fps=fps,
            # Unnamed, the codec is looked for by encoding something; the library's own ffmpeg has this one.
            codec="libx264" if Path(imageio_ffmpeg.get_ffmpeg_exe()).parent.name == "binaries" else None,
            quality=7,
            macro_block_size=2,
            output_params=["-preset", "veryfast", "-movflags", "+faststart"],
            ffmpeg_log_level="error",
        )
        made.send(None)
        self._writer = made
        self._send(first)


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
