"""Recorded frames in order: numbered colour and depth pictures, checked as a whole."""

from __future__ import annotations

import json
import math
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.robot.backend import CameraFrames
from gvla2.robot.calibration import Calibration
from gvla2_plugins.replay_camera import ReplayConfig

CAMERA = "camera.json"
MILLIMETRE = 0.001
FARTHEST = 100.0
"""Metres; a picture with a larger median depth was stored in other units."""

_NUMBER = re.compile(r"(\d+)\.(rgb\.png|depth\.png|depth\.npy)")


class FrameFolder:
    """One camera's recording, read once to check it.

    Raises :class:`RobotError`, naming the file: no frames, half a frame, mixed sizes, depth of 8 bits, damaged pixels,
    a calibration that is refused.
    """

    def __init__(self, folder: Path, name: str, serial: str = "") -> None:
        self.folder, self.name = folder, name
        self.calibration = Calibration.load(folder / CAMERA, serial)
        self._scale = _depth_scale(folder / CAMERA)
        self._pairs = _pairs(folder)
        for index in range(len(self)):
            self.view(index, np.eye(4))

    def __len__(self) -> int:
        return len(self._pairs)

    def view(self, index: int, base_from_tcp: FloatArray | None) -> View:
        """The frame in the base frame; ``base_from_tcp`` (4, 4) is needed by a camera that was on the hand."""
        camera = self.calibration.camera(self.name, base_from_tcp)
        colour, depth = self._pairs[index]
        shown = {colour: _picture(colour, "RGB"), depth: self._depth(depth)}
        for path, image in shown.items():
            if image.shape[:2] != (camera.height, camera.width):
                raise RobotError(
                    f"{path} has {image.shape[1]}x{image.shape[0]} pixels, the camera of {path.with_name(CAMERA)} "
                    f"{camera.width}x{camera.height}. All frames of a folder have the calibration's size."
                )
        return View(camera, shown[colour], shown[depth])

    def _depth(self, path: Path) -> NDArray[np.float32]:
        raw = _picture(path)
        if raw.ndim != 2 or raw.dtype.kind not in "fiu" or raw.dtype.itemsize < 2:
            raise RobotError(
                f"{path} must be a depth map (H, W) of numbers of 16 bits or more; it is {raw.shape}, {raw.dtype}."
            )
        scale = 1.0 if raw.dtype.kind == "f" else self._scale
        metres = raw.astype(np.float64) * scale
        metres[~(np.isfinite(metres) & (metres > 0))] = np.nan
        known = metres[np.isfinite(metres)]
        if known.size and np.median(known) > FARTHEST:
            raise RobotError(
                f"{path}: half of what it shows is farther than {np.median(known):.0f} m. Floats are metres; other "
                f"numbers are units of {self._scale} m, see depth_scale in {CAMERA}."
            )
        return metres.astype(np.float32)


def _pairs(folder: Path) -> list[tuple[Path, Path]]:
    """The frames by number: the colour file and the depth file of each."""
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
    return [(frame["rgb"], frame["depth"]) for _, frame in sorted(found.items())]


def _depth_scale(path: Path) -> float:
    given = json.loads(path.read_text()).get(
        "depth_scale", MILLIMETRE
    )  # Calibration.load has read it as JSON
    if not isinstance(given, int | float) or not (0 < given < math.inf):
        raise RobotError(f"{path}: depth_scale is {given!r}; it is metres per unit, such as 0.001.")
    return float(given)


def _picture(path: Path, mode: str | None = None) -> NDArray[Any]:
    """The pixels (H, W) or (H, W, 3) of a picture or an array."""
    try:
        if path.suffix == ".npy":
            return np.asarray(np.load(path, allow_pickle=False))
        with Image.open(path) as picture:
            picture.load()
            return np.array(picture.convert(mode) if mode else picture)
    except (OSError, ValueError, SyntaxError) as error:  # the last is what Pillow makes of a broken chunk
        raise RobotError(f"{path} is not a readable picture: {error}.") from error


class ReplayCamera:
    """Implements :class:`gvla2.robot.backend.DepthCamera`.

    Frames are returned as if taken on request; an arm that moves by them moves by the past. Raises
    :class:`ConfigurationError` for a missing path, :class:`RobotError`, naming the file, for a recording that can't be
    used.
    """

    def __init__(self, config: ReplayConfig) -> None:
        if not config.path:
            raise ConfigurationError("camera=replay needs a recording: camera.path=FOLDER.")
        path = self._path = Path(config.path).expanduser()
        if not path.exists():
            raise ConfigurationError(f"camera.path: there is nothing at '{path}'.")
        if (path / CAMERA).is_file():
            self._cameras = [FrameFolder(path, "replay", config.serial)]
        else:
            folders = sorted(file.parent for file in path.glob(f"*/{CAMERA}"))
            self._cameras = [FrameFolder(folder, folder.name, config.serial) for folder in folders]
        if not self._cameras:
            raise RobotError(f"{path} is not a recording: it holds no {CAMERA}, nor folders with one.")
        counts = {str(camera.folder): len(camera) for camera in self._cameras}
        if len(set(counts.values())) > 1:
            listing = ", ".join(f"{folder} has {count}" for folder, count in counts.items())
            raise RobotError(f"The cameras of a recording have a frame each at every moment; {listing}.")
        self._next, self._closed = 0, False

    @property
    def live(self) -> bool:
        """False: a recording shows the past."""
        return False

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """The next frame of every camera, and the last again at the end."""
        if self._closed:
            raise RobotError(f"The recording {self._path} is closed.")
        views = tuple(camera.view(self._next, base_from_tcp) for camera in self._cameras)
        self._next = min(self._next + 1, len(self._cameras[0]) - 1)
        return CameraFrames(views, (time.time(),) * len(views))

    def close(self) -> None:
        """Nothing is open, but no more frames are shown."""
        self._closed = True
