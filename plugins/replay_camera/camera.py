"""Frames in order, from any kind of recording."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, GeometryError, RobotError
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid
from gvla2.geometry.view_folders import ARCHIVE, read_archive
from gvla2.geometry.views import View
from gvla2.robot.backend import CameraFrames
from gvla2_plugins.replay_camera import AtEnd, ReplayConfig
from gvla2_plugins.replay_camera.frames import CAMERA, FrameFolder

Moment = Callable[[int, FloatArray | None], tuple[View, ...]]
"""The views of a frame by its place, where the tool is at base_from_tcp (4, 4)."""


class ReplayCamera:
    """Implements :class:`gvla2.robot.backend.DepthCamera`.

    Frames are returned as if taken on request; an arm that moves by them moves by the past. Raises
    :class:`ConfigurationError` for a missing path, :class:`RobotError`, naming the file, for a recording that can't be
    used.
    """

    def __init__(self, config: ReplayConfig) -> None:
        if not config.path:
            raise ConfigurationError("camera=replay needs a recording: camera.path=FOLDER.")
        self._path = Path(config.path).expanduser()
        if not self._path.exists():
            raise ConfigurationError(f"camera.path: there is nothing at '{self._path}'.")
        self._at_end = config.at_end
        self._count, self._moment = self._open(config)
        self._next = 0
        self._closed = False

    @property
    def live(self) -> bool:
        """False: a recording shows the past."""
        return False

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """The next frame of every camera. Raises :class:`RobotError` after the last with ``at_end=stop``."""
        if self._closed:
            raise RobotError(f"The recording {self._path} is closed.")
        if self._next >= self._count:
            if self._at_end is AtEnd.stop:
                raise RobotError(
                    f"The recording {self._path} is at its end, after {self._count} frames. camera.at_end=stay "
                    f"continues with the last, again with the first."
                )
            self._next = self._count - 1 if self._at_end is AtEnd.stay else 0
        views = self._moment(self._next, base_from_tcp)
        self._next += 1
        return CameraFrames(views, (time.time(),) * len(views))

    def close(self) -> None:
        """Nothing is open, but no more frames are shown."""
        self._closed = True

    def _open(self, config: ReplayConfig) -> tuple[int, Moment]:
        path = self._path
        if path.is_file():
            return 1, _archive(path, config)
        if (path / CAMERA).is_file():
            return _side_by_side([FrameFolder(path, "replay", config.serial)])
        if (path / ARCHIVE).is_file():
            return 1, _archive(path / ARCHIVE, config)
        cameras = sorted(file.parent for file in path.glob(f"*/{CAMERA}"))
        if not cameras:
            raise RobotError(
                f"{path} is not a recording: it holds neither {CAMERA} nor {ARCHIVE}, nor folders with a {CAMERA}."
            )
        return _side_by_side([FrameFolder(folder, folder.name, config.serial) for folder in cameras])


def _side_by_side(cameras: list[FrameFolder]) -> tuple[int, Moment]:
    counts = {str(camera.folder): len(camera) for camera in cameras}
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{folder} has {count}" for folder, count in counts.items())
        raise RobotError(f"The cameras of a recording have a frame each at every moment; {told}.")

    def moment(index: int, base_from_tcp: FloatArray | None) -> tuple[View, ...]:
        return tuple(camera.view(index, base_from_tcp) for camera in cameras)

    return len(cameras[0]), moment


def _archive(path: Path, config: ReplayConfig) -> Moment:
    """The one moment of a run's views, moved from its world into the base frame, without what it made of them."""
    world_from_base = _base(config)
    if config.serial:
        raise ConfigurationError(
            f"camera.serial can't be compared: {path} does not say whose views it holds."
        )
    try:
        views = read_archive(path)
    except GeometryError as error:
        raise RobotError(str(error)) from error
    if blind := [view.name for view in views if view.depth is None]:
        raise RobotError(f"{path}: the view '{blind[0]}' has no depth.")
    shown = tuple(
        replace(
            view,
            camera=replace(
                view.camera, world_from_camera=invert_rigid(world_from_base) @ view.camera.world_from_camera
            ),
            mask=None,
            robot_mask=None,
        )
        for view in views
    )
    return lambda index, base_from_tcp: shown


def _base(config: ReplayConfig) -> FloatArray:
    position = np.array(config.base_position, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite([*position, config.base_yaw]).all():
        raise ConfigurationError("camera.base_position are three numbers, metres; base_yaw is one, radians.")
    return rigid(Rotation.from_euler("z", config.base_yaw).as_matrix(), position)
