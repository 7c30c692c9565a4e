"""Recorded frames in order: numbered colour and depth pictures, checked as a whole."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.io.foreign import read_array, read_picture
from gvla2.robot.backend import CameraFrames
from gvla2.robot.calibration import Calibration
from gvla2_plugins.replay_camera import ReplayConfig

CAMERA = "camera.json"
FARTHEST = 100.0
"""Metres; a picture with a larger median depth was stored in other units."""


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
        folders = [path] if (path / CAMERA).is_file() else sorted(p.parent for p in path.glob(f"*/{CAMERA}"))
        if not folders:
            raise RobotError(f"{path} is not a recording: it holds no {CAMERA}, nor folders with one.")
        self._cameras = [FrameFolder(one, "replay" if one == path else one.name) for one in folders]
        counts = {str(camera.folder): len(camera.frames) for camera in self._cameras}
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
        self._next = min(self._next + 1, len(self._cameras[0].frames) - 1)
        return CameraFrames(views, (time.time(),) * len(views))

    def close(self) -> None:
        """Nothing is open, but no more frames are shown."""
        self._closed = True


class FrameFolder:
    """One camera's recording: ``frames`` are the colour and the depth file of each. Read once to check it."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        self.calibration = Calibration.load(folder / CAMERA)
        self._scale = json.loads((folder / CAMERA).read_text("utf-8-sig")).get("depth_scale", 0.001)
        if not isinstance(self._scale, int | float) or not 0 < self._scale < math.inf:
            raise RobotError(
                f"{folder / CAMERA}: depth_scale is {self._scale!r}; it is metres per unit: 0.001."
            )
        numbers = {path.name.partition(".")[0] for path in folder.glob("[0-9]*.*")}
        self.frames = [_pair(folder, number) for number in sorted(filter(str.isdecimal, numbers), key=int)]
        if not self.frames:
            raise RobotError(f"{folder} holds no frames: there is no 000.rgb.png with 000.depth.png or .npy.")
        for index in range(len(self.frames)):
            self.view(index, np.eye(4))

    def view(self, index: int, base_from_tcp: FloatArray | None) -> View:
        """The frame in the base frame; ``base_from_tcp`` (4, 4) is needed by a camera that was on the hand."""
        camera = self.calibration.camera(self.name, base_from_tcp)
        colour, depth = self.frames[index]
        image, metres = _picture(colour, "RGB"), self._depth(depth)
        for path, pixels in ((colour, image), (depth, metres)):
            if pixels.shape[:2] != (camera.height, camera.width):
                raise RobotError(
                    f"{path} has {pixels.shape[1]}x{pixels.shape[0]} pixels, the camera of {path.with_name(CAMERA)} "
                    f"{camera.width}x{camera.height}. All frames of a folder have the calibration's size."
                )
        return View(camera, image, metres)

    def _depth(self, path: Path) -> NDArray[np.float32]:
        raw = _picture(path)
        if raw.ndim != 2 or raw.dtype.kind not in "fiu" or raw.dtype.itemsize < 2:
            raise RobotError(
                f"{path} must be a depth map (H, W) of numbers of 16 bits or more; it is {raw.shape}, {raw.dtype}."
            )
        metres = raw * (1.0 if raw.dtype.kind == "f" else self._scale)
        metres[~(np.isfinite(metres) & (metres > 0))] = np.nan
        known = metres[np.isfinite(metres)]
        if known.size and np.median(known) > FARTHEST:
            raise RobotError(
                f"{path}: half of what it shows is farther than {np.median(known):.0f} m. Floats are metres; other "
                f"numbers are units of {self._scale} m, see depth_scale in {CAMERA}."
            )
        return metres.astype(np.float32)


def _pair(folder: Path, number: str) -> tuple[Path, Path]:
    """The colour and the depth file of a frame."""
    colour, array, depth = (folder / f"{number}.{kind}" for kind in ("rgb.png", "depth.npy", "depth.png"))
    found = [path for path in (array, depth) if path.is_file()]
    if len(found) != 1 or not colour.is_file():
        raise RobotError(
            f"{folder}: frame {number} needs {colour.name} and one of {depth.name} and {array.name}."
        )
    return colour, found[0]


def _picture(path: Path, mode: str | None = None) -> NDArray[Any]:
    """The pixels (H, W) or (H, W, 3) of a picture or an array."""
    if path.suffix == ".npy":
        return read_array(path, "the depth", RobotError)
    picture = read_picture(path, RobotError)
    return np.array(picture.convert(mode) if mode else picture)
