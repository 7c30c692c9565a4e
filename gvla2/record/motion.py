"""Films (MP4, H.264), and the motion of an episode: a film of every frame and the arm's measured state at each of them.

`gvla2 export lerobot` makes training data sets from both.
"""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from gvla2.errors import OutputError
from gvla2.io.files import write_bytes
from gvla2.robot.backend import Moment

Frame = NDArray[np.uint8]
"""An RGB picture (H, W, 3)."""
Film = Generator[None, bytes | None, None]
"""imageio-ffmpeg's open film: takes the bytes of one frame at a time."""

FILM, STATES = "episode.mp4", "motion.npz"
UNFINISHED = ".episode.mp4"
"""The film while it is written: what a run that dies leaves does not look like a film."""
DEFAULT_FPS = 5.0
SMALLEST = 16
"""Minimum side of a film in pixels: encoders refuse smaller ones."""
AHEAD = 30
"""Frames that may wait for the encoder."""


class Motion:
    """Writes the film while the robot moves, in a thread of its own: an encoder takes 0.3 s to start.

    :meth:`finish` closes it and writes the states; it raises :class:`OutputError` for what cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._moments: list[Moment] = []
        self._film: Film | None = None
        self._first: Frame | None = None  # waits for the second, whose time gives the rate
        self._frames = 0
        self._studio = ThreadPoolExecutor(1, "film")
        self._awaited: deque[Future[None]] = deque()

    def moment(self, moment: Moment) -> None:
        """The state at the next frame."""
        self._moments.append(replace(moment, draw=None))  # which holds on to the scene it would draw

    def frame(self, image: Frame) -> None:
        """A frame, as large as the first one; sides are cropped to even numbers, as players require."""
        if getattr(image, "ndim", 0) != 3 or min(image.shape[:2]) < SMALLEST:
            return
        cropped = even(image)
        self._frames += 1
        if self._first is None:
            self._first = cropped
            return
        if self._frames == 2:
            self._later(self._open, self._first, self.fps)
        self._later(self._send, cropped)

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
            if self._film is not None:
                self._film.close()
                self._film = None
                check_whole(self._folder / UNFINISHED).replace(self._folder / FILM)
        if self._moments and len(self._moments) == self._frames:
            stream = io.BytesIO()
            given = [m.command for m in self._moments if m.command is not None]
            commands: dict[str, Any] = {"command": np.array(given)} if len(given) == self._frames else {}
            np.savez_compressed(
                stream,
                time=np.array([m.time for m in self._moments]),
                joints=np.array([m.joints for m in self._moments]),
                gripper_width=np.array([m.gripper_width for m in self._moments]),
                **commands,
                fps=np.array(self.fps),
            )
            write_bytes(self._folder / STATES, stream.getvalue())

    def _later(self, act: Callable[..., None], *inputs: Any) -> None:
        self._awaited.append(self._studio.submit(act, *inputs))
        while self._awaited and (self._awaited[0].done() or len(self._awaited) > AHEAD):
            self._awaited.popleft().result()

    def _open(self, first: Frame, fps: float) -> None:
        self._film = opened(self._folder / UNFINISHED, first, fps)
        self._send(first)

    def _send(self, image: Frame) -> None:
        if self._film is not None:
            self._film.send(image.tobytes())


def check_whole(film: Path) -> Path:
    """The film; removes one that is cut, and raises :class:`OutputError`: the encoder does not say so."""
    content, at, boxes = film.read_bytes() if film.is_file() else b"", 0, set()
    while at < len(content):  # the boxes of an MP4 file follow one another
        boxes.add(content[at + 4 : at + 8])
        at += max(int.from_bytes(content[at : at + 4], "big"), 8)
    if at != len(content) or not {b"moov", b"mdat"} <= boxes:
        film.unlink(missing_ok=True)
        raise OutputError(f"The film '{film}' could not be written whole. Check the disk's free space.")
    return film


def even(image: Frame) -> Frame:
    """A picture cropped to even sides."""
    return np.ascontiguousarray(image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2])


def opened(path: Path, first: Frame, fps: float) -> Film:
    """A new film of pictures of the size of ``first``."""
    film: Film = imageio_ffmpeg.write_frames(
        str(path),
        (first.shape[1], first.shape[0]),
        fps=fps,
        # Unnamed, the codec is looked for by encoding something; the library's own ffmpeg has this one.
        codec="libx264" if Path(imageio_ffmpeg.get_ffmpeg_exe()).parent.name == "binaries" else None,
        quality=7,
        macro_block_size=2,
        output_params=["-preset", "veryfast", "-movflags", "+faststart"],
        ffmpeg_log_level="fatal",
    )
    film.send(None)
    return film
