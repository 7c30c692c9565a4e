"""The camera of a robot: a live stream, placed by that camera's hand-eye calibration."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gvla2.errors import ConfigurationError, MissingDependencyError, RobotError
from gvla2.geometry.camera import Camera as Pinhole
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.robot.backend import CameraFrames
from gvla2.robot.calibration import Calibration, Intrinsics
from gvla2_plugins.realsense import RealsenseConfig
from gvla2_plugins.realsense.lens import colour_axis, lens_of, pinhole
from gvla2_plugins.realsense.stream import Stream, name_of, serial_of

TOLERANCE = 0.02
"""How far the stream's focal length and principal point may be from the calibration's, as a share of its own."""


class RealsenseCamera:
    """Implements :class:`gvla2.robot.backend.DepthCamera`; streams from the constructor on.

    ``device`` is a librealsense device to be used instead of one that is plugged in, ``rs.software_device`` for
    example. Raises :class:`ConfigurationError` for invalid options, :class:`RobotError` for a missing or silent camera,
    and for another camera's calibration.
    """

    def __init__(self, config: RealsenseConfig, device: Any = None) -> None:
        _check(config)
        path = Path(config.calibration).expanduser()
        calibration = Calibration.load(path)
        rs = load()
        if device is None:
            try:
                self._context = rs.context()  # kept: it is what notices that a plug was pulled
                devices = list(self._context.query_devices())
            except RuntimeError as error:
                raise RobotError(f"librealsense can't look for cameras: {error}.") from error
            several = len(devices) > 1
            device = choose(rs, devices, config.serial or (calibration.serial if several else ""))
        self.calibration = Calibration.load(path, config.serial or serial_of(rs, device))
        self.serial = serial_of(rs, device)
        if config.serial and config.serial != self.serial:
            raise RobotError(f"camera.serial is '{config.serial}', the camera in use is '{self.serial}'.")
        size = (calibration.intrinsics.width, calibration.intrinsics.height)
        self._timeout = config.timeout
        self._stream = Stream(rs, device, size, config.fps)
        try:
            self.intrinsics = pinhole(self._stream.intrinsics)
            _agree(self.intrinsics, calibration, path)
            self._axis = colour_axis(self._stream.extrinsics, self.intrinsics)
            self._lens = lens_of(rs, self._stream.intrinsics)
            for _ in range(config.warm_up + 1):  # the last shows that pictures do come
                self._stream.next(0.0, config.timeout)
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
        pose = self._pose(base_from_tcp)
        picture = self._stream.next(time.time(), self._timeout)
        image, depth = picture.image, picture.depth
        if self._lens is not None:
            image, depth = self._lens.image(image), self._lens.depth(depth)
        depth = self._axis.depth(depth)
        i = self.intrinsics
        camera = Pinhole(i.K, pose, i.width, i.height, f"realsense-{self.serial}")
        return CameraFrames((View(camera, image, depth),), (picture.exposed,))

    def close(self) -> None:
        """Stop streaming; safe to call twice."""
        self._stream.close()

    def _pose(self, base_from_tcp: FloatArray | None) -> FloatArray:
        if self.calibration.mount == "eye_to_hand":
            return self.calibration.transform
        if base_from_tcp is None:
            raise RobotError(f"The camera '{self.serial}' is on the hand: it needs the hand's pose.")
        return base_from_tcp @ self.calibration.transform


def _check(config: RealsenseConfig) -> None:
    if not config.calibration:
        raise ConfigurationError(
            "camera=realsense needs to know where the camera stands: camera.calibration=FILE, made by "
            "`gvla2 calibrate`."
        )
    if config.fps <= 0 or config.warm_up < 0 or not 0 < config.timeout < float("inf"):
        raise ConfigurationError(
            f"camera.fps={config.fps} and camera.timeout={config.timeout} must be above 0, and "
            f"camera.warm_up={config.warm_up} not below."
        )


def _agree(stream: Intrinsics, calibration: Calibration, path: Path) -> None:
    """The camera must measure as it did when it was calibrated: another mode crops, and moves the centre."""
    wanted = calibration.intrinsics
    pairs = {
        "fx": (stream.fx, wanted.fx, wanted.fx),
        "fy": (stream.fy, wanted.fy, wanted.fy),
        "cx": (stream.cx, wanted.cx, wanted.width),
        "cy": (stream.cy, wanted.cy, wanted.height),
    }
    off = [f"{k} {a:.1f} for {b:.1f}" for k, (a, b, by) in pairs.items() if abs(a - b) > TOLERANCE * by]
    if off:
        raise RobotError(
            f"The camera '{calibration.serial}' has other intrinsics than its calibration {path} says: "
            f"{', '.join(off)} pixels. Calibrate again, in the mode that is to be used."
        )


_INSTALL = "pip install 'gvla2[realsense]'"


def load() -> Any:
    """The module ``pyrealsense2``.

    Raises :class:`MissingDependencyError` when it, or its libusb, is missing.
    """
    _offer_libusb()
    try:
        import pyrealsense2
    except ModuleNotFoundError as error:
        raise MissingDependencyError("pyrealsense2", "camera=realsense", _INSTALL, "Apache-2.0") from error
    except ImportError as error:
        raise MissingDependencyError(
            f"a library that pyrealsense2 links to ({error})", "camera=realsense", _INSTALL
        ) from error
    return pyrealsense2


def _offer_libusb() -> None:
    """Load the libusb of the package ``libusb_package`` for all, so that pyrealsense2 finds its symbols there.

    Without such a package, or if it does not fit this system, the system's own libusb may still work.
    """
    if os.name != "posix":
        return  # elsewhere the wheel has what it needs
    try:
        import libusb_package

        path = libusb_package.get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    except (ImportError, OSError):
        return


_WEBCAM = "Platform Camera"
"""librealsense's name for a foreign camera."""

_RETIRED = (
    " L5xx and SR3xx cameras need pyrealsense2<2.55; or record with other software and use camera=replay."
)


def choose(rs: Any, devices: Sequence[Any], serial: str = "") -> Any:
    """The device of that serial, or the only one there is.

    Raises :class:`RobotError`, listing the connected ones.
    """
    found = {serial_of(rs, d): d for d in devices if name_of(rs, d) != _WEBCAM}
    if serial in found:
        return found[serial]
    listing = ", ".join(f"{name_of(rs, device)} '{key}'" for key, device in found.items())
    if serial and found:
        raise RobotError(f"No camera with the serial '{serial}' is plugged in; there is {listing}.{_RETIRED}")
    if not found:
        asked = f" '{serial}'" if serial else ""
        raise RobotError(
            f"librealsense finds no camera{asked}. Plug it into a USB 3 port; on Linux, librealsense's udev rules "
            f"give users access to it.{_RETIRED}"
        )
    if len(found) > 1:
        raise RobotError(f"Several cameras are plugged in: {listing}. Choose one with camera.serial=...")
    return next(iter(found.values()))
