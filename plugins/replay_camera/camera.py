"""Recorded frames in order: numbered folders of views, checked as a whole."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from gvla2.errors import ConfigurationError, GeometryError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.view_folders import CAMERAS, cameras_of, read_views
from gvla2.geometry.views import Views
from gvla2.robot.backend import CameraFrames
from gvla2_plugins.replay_camera import ReplayConfig

FARTHEST = 100.0
"""Metres; a view with a larger median depth was stored in other units."""


class ReplayCamera:
    """Implements :class:`gvla2.robot.backend.DepthCamera`.

    Frames are returned as if taken on request; an arm that moves by them moves by the past. Poses are of the arm's
    base frame, those of cameras on the hand included. Raises :class:`ConfigurationError` for a missing path,
    :class:`RobotError`, naming the file, for a recording that can't be used; all frames are read once to check them.
    """

    def __init__(self, config: ReplayConfig) -> None:
        if not config.path:
            raise ConfigurationError("camera=replay needs a recording: camera.path=FOLDER.")
        path = self._path = Path(config.path).expanduser()
        if not path.exists():
            raise ConfigurationError(f"camera.path: there is nothing at '{path}'.")
        numbered = {int(p.name): p for p in path.glob("[0-9]*") if p.name.isdecimal() and p.is_dir()}
        self._frames = [path] if cameras_of(path).is_file() else [numbered[n] for n in sorted(numbered)]
        if not self._frames:
            raise RobotError(
                f"{path} is not a recording: it holds no {CAMERAS}, nor folders 000, 001, ... with one."
            )
        names = {frame: [view.name for view in _read(frame)] for frame in self._frames}
        if other := [frame for frame in self._frames if names[frame] != names[self._frames[0]]]:
            raise RobotError(
                f"All frames of a recording have the same cameras; {self._frames[0]} has "
                f"{', '.join(names[self._frames[0]])}, {other[0]} has {', '.join(names[other[0]])}."
            )
        self._next, self._closed = 0, False

    @property
    def live(self) -> bool:
        """False: a recording shows the past."""
        return False

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """The next frame of every camera, and the last again at the end."""
        if self._closed:
            raise RobotError(f"The recording {self._path} is closed.")
        views = tuple(_read(self._frames[self._next]))
        self._next = min(self._next + 1, len(self._frames) - 1)
        return CameraFrames(views, (time.time(),) * len(views))

    def close(self) -> None:
        """Nothing is open, but no more frames are shown."""
        self._closed = True


def _read(folder: Path) -> Views:
    """The views of a frame, depth in metres, NaN where nothing was measured; without a mask, which shows one object."""
    try:
        views = read_views(folder)
    except GeometryError as error:
        raise RobotError(str(error)) from error
    for view in views:
        if view.depth is None:
            raise RobotError(f"{folder}: view '{view.name}' has no depth, depth/NAME.npy.")
        known = view.depth[np.isfinite(view.depth)]
        if known.size and np.median(known) > FARTHEST:
            raise RobotError(
                f"{folder}: half of what view '{view.name}' shows is farther than {np.median(known):.0f} m. "
                "Depth is in metres."
            )
    return Views(tuple(replace(view, mask=None) for view in views))
