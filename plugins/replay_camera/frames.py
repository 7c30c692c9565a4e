"""A folder of numbered colour and depth pictures, checked as a whole before the first is shown."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import RobotError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.robot.calibration import Calibration

CAMERA = "camera.json"
MILLIMETRE = 0.001
FARTHEST = 100.0
"""Metres; a picture with a larger median depth was stored in other units."""

_NUMBER = re.compile(r"(\d+)\.(rgb\.png|depth\.png|depth\.npy)")
_DEPTH_MODES = ("I;16", "I;16B", "I;16L", "I")


@dataclass(frozen=True)
class Pair:
    """The two files of one moment."""

    colour: Path
    depth: Path


class FrameFolder:
    """One camera's recording. Raises :class:`RobotError`, naming the file, for everything that could make :meth:`view`
    fail except damaged pixels: no frames, half a frame, mixed sizes, depth of 8 bits, a calibration that is refused.
    """

    def __init__(self, folder: Path, name: str, serial: str = "") -> None:
        self.folder, self.name = folder, name
        self.calibration = Calibration.load(folder / CAMERA, serial)
        self._scale = _depth_scale(folder / CAMERA)
        self._pairs = _pairs(folder)
        for pair in self._pairs:
            for path in (pair.colour, pair.depth):
                self._check_size(path, _size(path))

    def __len__(self) -> int:
        return len(self._pairs)

    def view(self, index: int, base_from_tcp: FloatArray | None) -> View:
        """The frame in the base frame; ``base_from_tcp`` (4, 4) is needed by a camera that was on the hand."""
        pose, intrinsics = self.calibration.transform, self.calibration.intrinsics
        if self.calibration.mount == "eye_in_hand":
            if base_from_tcp is None:
                raise RobotError(f"{self.folder} was recorded from the hand: it needs the hand's pose.")
            pose = base_from_tcp @ pose
        camera = Camera(intrinsics.K, pose, intrinsics.width, intrinsics.height, self.name)
        pair = self._pairs[index]
        return View(camera, _colour(pair.colour), self._depth(pair.depth))

    def _check_size(self, path: Path, size: tuple[int, int]) -> None:
        wanted = (self.calibration.intrinsics.width, self.calibration.intrinsics.height)
        if size != wanted:
            raise RobotError(
                f"{path} has {size[0]}x{size[1]} pixels, the camera of {path.with_name(CAMERA)} {wanted[0]}x"
                f"{wanted[1]}. All frames of a folder have the calibration's size."
            )

    def _depth(self, path: Path) -> NDArray[np.float32]:
        if path.suffix == ".npy":
            raw = _array(path)
            scale = 1.0 if raw.dtype.kind == "f" else self._scale
        else:
            raw, scale = np.asarray(_loaded(path)), self._scale
        metres = raw.astype(np.float64) * scale
        metres[~(np.isfinite(metres) & (metres > 0))] = np.nan
        known = metres[np.isfinite(metres)]
        if known.size and np.median(known) > FARTHEST:
            raise RobotError(
                f"{path}: half of what it shows is farther than {np.median(known):.0f} m. Floats are metres; other "
                f"numbers are units of {self._scale} m, see depth_scale in {CAMERA}."
            )
        return metres.astype(np.float32)


def _pairs(folder: Path) -> list[Pair]:
    """The frames by number; each has a colour file and one depth file."""
    found: dict[int, dict[str, Path]] = {}
    for path in sorted(folder.iterdir()):
        if match := _NUMBER.fullmatch(path.name):
            kind = match[2].partition(".")[0]
            frame = found.setdefault(int(match[1]), {})
            if kind in frame:
                raise RobotError(f"{path} and {frame[kind].name} are the same frame; keep one of them.")
            frame[kind] = path
    if not found:
        raise RobotError(f"{folder} holds no frames: there is no 000.rgb.png with 000.depth.png or .npy.")
    for frame in found.values():
        if len(frame) == 1:
            kind, path = next(iter(frame.items()))
            other = "depth.png or .npy" if kind == "rgb" else "rgb.png"
            raise RobotError(f"{path} is half a frame: there is no {path.name.partition('.')[0]}.{other}.")
    return [Pair(frame["rgb"], frame["depth"]) for _, frame in sorted(found.items())]


def _depth_scale(path: Path) -> float:
    given = json.loads(path.read_text()).get(
        "depth_scale", MILLIMETRE
    )  # Calibration.load has read it as JSON
    if not isinstance(given, int | float) or not (0 < given < math.inf):
        raise RobotError(f"{path}: depth_scale is {given!r}; it is metres per unit, such as 0.001.")
    return float(given)


def _size(path: Path) -> tuple[int, int]:
    """Width and height by the file's head, and whether it is a kind of picture that can be shown."""
    if path.suffix == ".npy":
        array = _array(path)
        if array.ndim != 2 or array.dtype.kind not in "fiu":
            raise RobotError(
                f"{path} must be a depth map (H, W) of numbers; it is {array.shape}, {array.dtype}."
            )
        return array.shape[1], array.shape[0]
    try:
        with Image.open(path) as picture:
            if ".depth." in path.name and picture.mode not in _DEPTH_MODES:
                raise RobotError(
                    f"{path} is a picture of mode {picture.mode}; depth is stored in one channel of 16 bits."
                )
            return picture.size
    except OSError as error:
        raise RobotError(f"{path} is not a readable picture: {error}.") from error


def _array(path: Path) -> NDArray[Any]:
    try:
        loaded = np.load(path, mmap_mode="r", allow_pickle=False)
        if not isinstance(loaded, np.ndarray):
            raise ValueError("it is an archive")
    except (OSError, ValueError, EOFError) as error:
        raise RobotError(f"{path} is not a readable array: {error}.") from error
    return loaded


def _colour(path: Path) -> NDArray[np.uint8]:
    return np.array(_loaded(path, "RGB"))


def _loaded(path: Path, mode: str | None = None) -> Image.Image:
    try:
        with Image.open(path) as picture:
            picture.load()
            return picture.convert(mode) if mode else picture.copy()
    except (OSError, SyntaxError) as error:  # the latter is what Pillow makes of a broken chunk
        raise RobotError(f"{path} is damaged: {error}.") from error
