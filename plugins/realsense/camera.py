"""The camera of a robot: a librealsense device, depth aligned to colour, placed by its hand-eye calibration."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError, RobotError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.robot.backend import CameraFrames
from gvla2.robot.calibration import Calibration, pinhole
from gvla2_plugins.realsense import RealsenseConfig

TOLERANCE = 0.02
"""How far the stream's focal length and principal point may be from the calibration's, as a share of its own."""

_SLICE_MS = 250
"""Longest single wait: in between, Ctrl-C and the connection are checked."""


class RealsenseCamera:
    """Implements :class:`gvla2.robot.backend.DepthCamera`; streams from the constructor on.

    ``device`` is a librealsense device to be used instead of one that is plugged in, ``rs.software_device`` for
    example. Raises :class:`ConfigurationError` for invalid options, :class:`RobotError` for a missing or silent camera,
    and for another camera's calibration.
    """

    def __init__(self, config: RealsenseConfig, device: Any = None) -> None:
        if not config.calibration:
            raise ConfigurationError(
                "camera=realsense needs to know where the camera stands: camera.calibration=FILE, made by "
                "examples/08_hand_eye.py."
            )
        path = Path(config.calibration).expanduser()
        calibration = Calibration.load(path)
        self._rs = rs = load()
        if device is None:
            self._context = rs.context()  # kept: it is what notices that a plug was pulled
            found = {serial_of(rs, one): one for one in self._context.query_devices()}
            wanted = config.serial or (calibration.serial if len(found) > 1 else next(iter(found), ""))
            if wanted not in found:
                raise RobotError(
                    f"librealsense finds no camera '{wanted}'; there is {', '.join(found) or 'none'}. Choose one by "
                    "camera.serial=..., or plug it into a USB 3 port; on Linux, librealsense's udev rules give users "
                    "access to it. L5xx and SR3xx cameras need pyrealsense2<2.55."
                )
            device = found[wanted]
        self._device, self.serial = device, serial_of(rs, device)
        self.calibration = Calibration.load(path, config.serial or self.serial)
        self._timeout = config.timeout
        self._align, self._queue, self._last = rs.align(rs.stream.color), rs.syncer(), [-1, -1]
        self._running: list[Any] = []
        size = calibration.lens.width, calibration.lens.height
        colour = self._profile(rs.stream.color, rs.format.rgb8, size, config.fps, "colour")
        depth = self._profile(rs.stream.depth, rs.format.z16, size, config.fps, "depth")
        self._sizes, self._period = [_size(profile) for _, profile in (colour, depth)], 1.0 / config.fps
        given = colour[1].as_video_stream_profile().get_intrinsics()
        # librealsense counts from the first pixel's centre, we from its corner.
        centre = float(given.ppx) + 0.5, float(given.ppy) + 0.5
        lens = pinhole(float(given.fx), float(given.fy), *centre, *size, calibration.lens.world_from_camera)
        off = np.abs(lens.K - calibration.lens.K)[:2] / np.maximum(
            calibration.lens.K[:2], np.c_[size, size, size]
        )
        if off.max() > TOLERANCE:  # another mode crops, and moves the centre
            raise RobotError(
                f"The camera '{self.serial}' has other intrinsics than its calibration {path} says: "
                f"{lens.K[:2].round(1).tolist()} for {calibration.lens.K[:2].round(1).tolist()} pixels. Calibrate "
                "again, in the mode that is to be used."
            )
        self.calibration = replace(self.calibration, lens=lens)
        self._lens = lens_of(rs, given)
        try:
            self._shift, self._share = _colour_axis(depth[1].get_extrinsics_to(colour[1]), lens)
            by_sensor: dict[str, tuple[Any, list[Any]]] = {}  # some have one sensor for both
            for sensor, profile in (colour, depth):
                name = sensor.get_info(rs.camera_info.name)
                by_sensor.setdefault(name, (sensor, []))[1].append(profile)
            for sensor, profiles in by_sensor.values():
                sensor.open(profiles)
                self._running.append(sensor)
                sensor.start(self._queue)
            for _ in range(config.warm_up + 1):  # the last shows that pictures do come
                self._next(0.0)
        except RuntimeError as error:  # the only type that librealsense raises
            self.close()
            raise RobotError(f"The camera '{self.serial}' can't be started: {error}.") from error
        except BaseException:
            self.close()
            raise

    @property
    def live(self) -> bool:
        """Always."""
        return True

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """One view, exposed after the call began; ``base_from_tcp`` (4, 4) is needed by a camera on the hand.

        Raises :class:`RobotError` when the camera was unplugged, is frozen, or changes its pictures' size.
        """
        camera = self.calibration.camera(f"realsense-{self.serial}", base_from_tcp)
        frames, exposed = self._next(time.time())
        aligned = self._align.process(frames)
        image = np.array(np.asanyarray(aligned.get_color_frame().get_data()))  # the frame's memory goes back
        raw = aligned.get_depth_frame()
        depth = np.asanyarray(raw.get_data()).astype(np.float32) * np.float32(raw.get_units())
        depth = np.where(depth > 0, depth, np.float32(np.nan))
        if self._lens is not None:
            image = np.asarray(cv2.remap(image, *self._lens, cv2.INTER_LINEAR), dtype=np.uint8)
            # From the nearest pixel: averages across an edge would lie on no surface.
            depth = cv2.remap(depth, *self._lens, cv2.INTER_NEAREST, borderValue=np.nan)
        depth = ((depth + self._shift) / self._share).astype(np.float32)
        return CameraFrames((View(camera, image, depth),), (exposed,))

    def close(self) -> None:
        """Stop the sensors; safe to call twice, and after the plug was pulled."""
        for sensor in reversed(self._running):
            for end in (sensor.stop, sensor.close):
                try:
                    end()
                except RuntimeError:
                    continue  # never started, or unplugged: nothing to stop
        self._running = []

    def _profile(self, stream: Any, kind: Any, size: tuple[int, int], fps: int, what: str) -> tuple[Any, Any]:
        """The sensor and profile of a stream at ``fps``: colour of exactly ``size``, depth of the nearest size."""
        sensors = self._device.query_sensors()
        offers = [(sensor, profile) for sensor in sensors for profile in sensor.get_stream_profiles()]
        offers = [o for o in offers if o[1].stream_type() == stream and o[1].format() == kind]

        def distance(offer: tuple[Any, Any]) -> float:
            return float(np.abs(np.subtract(_size(offer[1]), size)).sum())

        fit = min((o for o in offers if o[1].fps() == fps), key=distance, default=None)
        if fit is None or (what == "colour" and distance(fit) > 0):
            have = ", ".join(sorted({"{}x{}@{}".format(*_size(p), p.fps()) for _, p in offers})) or "none"
            raise RobotError(
                f"The camera '{self.serial}' has no {what} of {size[0]}x{size[1]} at {fps} a second; it has {have}. "
                "The colour's size is the calibration's. A USB 3 port offers more than USB 2."
            )
        return fit

    def _next(self, began: float) -> tuple[Any, float]:
        """The first new pair of frames exposed after ``began``, and when it was exposed, both in ``time.time()``."""
        if not self._running:
            raise RobotError(f"The camera '{self.serial}' is closed.")
        deadline = time.monotonic() + self._timeout
        while time.monotonic() < deadline:
            waited, frames = self._queue.try_wait_for_frames(_SLICE_MS)
            exposed = time.time() - self._period  # at the earliest: a frame arrives within its period
            if not waited:
                continue
            pair = (frames.get_color_frame(), frames.get_depth_frame())
            if not all(pair) or not self._advanced(pair):
                continue
            if exposed >= began and [(f.get_width(), f.get_height()) for f in pair] == self._sizes:
                return frames, exposed
        why = "Is its cable firm?" if self._device.is_connected() else "It was unplugged."
        raise RobotError(
            f"The camera '{self.serial}' gave no new pair of colour and depth within {self._timeout:g} s. {why}"
        )

    def _advanced(self, pair: Sequence[Any]) -> bool:
        """Whether both frames are new: a frozen camera repeats old ones."""
        numbers = [frame.get_frame_number() for frame in pair]
        fresh = all(new != old for new, old in zip(numbers, self._last, strict=True))
        self._last = numbers if fresh else self._last
        return fresh


def lens_of(rs: Any, given: Any) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Columns and rows (H, W) in the bent picture of each pixel of the straight one; None for a straight lens."""
    if given.model == rs.distortion.none or not any(given.coeffs):
        return None
    columns, rows = np.meshgrid(np.arange(given.width, dtype=float), np.arange(given.height, dtype=float))
    rays = np.stack([(columns - given.ppx) / given.fx, (rows - given.ppy) / given.fy, np.ones_like(rows)], -1)
    bent = np.array([rs.rs2_project_point_to_pixel(given, ray) for ray in rays.reshape(-1, 3).tolist()])
    x, y = bent.astype(np.float32).T.reshape(2, *rows.shape)
    return np.ascontiguousarray(x), np.ascontiguousarray(y)


def _colour_axis(extrinsics: Any, lens: Camera) -> tuple[float, FloatArray]:
    """What turns depths z_d along the depth sensor's axis into z_c along the colour camera's: shift, share (H, W).

    With colour_from_depth = (R, t), a point z_c r on the ray r of a colour pixel has z_d = R_3 . (z_c r - t), where
    R_3 is the third column of R. The shift is R_3 . t in metres, the share R_3 . r.
    """
    column = np.array(extrinsics.rotation[6:9], dtype=np.float64)  # librealsense stores column after column
    u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = np.stack([(u - lens.K[0, 2]) / lens.K[0, 0], (v - lens.K[1, 2]) / lens.K[1, 1]], -1)
    return float(column @ np.array(extrinsics.translation)), rays @ column[:2] + column[2]


def load() -> Any:
    """The module ``pyrealsense2``; raises :class:`MissingDependencyError` when it, or its libusb, is missing."""
    try:  # so that pyrealsense2 finds libusb's symbols; without this package the system's own may still work
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    except (ImportError, OSError):
        pass
    try:
        import pyrealsense2
    except ImportError as error:
        what = f"pyrealsense2 ({error})"
        raise MissingDependencyError(
            what, "camera=realsense", "pip install 'gvla2[realsense]'", "Apache-2.0"
        ) from error
    return pyrealsense2


def serial_of(rs: Any, device: Any) -> str:
    """The device's serial number, "" for a device that has none."""
    number = rs.camera_info.serial_number
    return str(device.get_info(number)) if device.supports(number) else ""


def _size(profile: Any) -> tuple[int, int]:
    video = profile.as_video_stream_profile()
    return video.width(), video.height()
