"""The camera of a robot: a live stream, its lens made straight, placed by that camera's hand-eye calibration."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.robot.backend import CameraFrames
from gvla2.robot.calibration import Calibration, Intrinsics
from gvla2_plugins.realsense import RealsenseConfig
from gvla2_plugins.realsense.stream import Stream, name_of, serial_of

NEGLIGIBLE = 0.25
"""Pixels; below this distortion everywhere, pictures are left unchanged."""


def pinhole(given: Any) -> Intrinsics:
    """Our intrinsics of a stream's. librealsense counts from the first pixel's centre, we from its corner."""
    return Intrinsics(
        float(given.fx),
        float(given.fy),
        float(given.ppx) + 0.5,
        float(given.ppy) + 0.5,
        int(given.width),
        int(given.height),
    )


@dataclass(frozen=True)
class Lens:
    """Where in the bent picture each pixel of the straight one lies: ``rows`` and ``columns`` (H, W), pixels."""

    rows: NDArray[np.float32]
    columns: NDArray[np.float32]

    def image(self, bent: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The straight picture (H, W, 3); black where the bent one does not reach."""
        return np.asarray(cv2.remap(bent, self.columns, self.rows, cv2.INTER_LINEAR), dtype=np.uint8)

    def depth(self, bent: NDArray[np.float32]) -> NDArray[np.float32]:
        """The straight depth (H, W), each from the nearest pixel: averages across an edge would lie on no surface."""
        nearest, outside = cv2.INTER_NEAREST, cv2.BORDER_CONSTANT
        straight = cv2.remap(bent, self.columns, self.rows, nearest, borderMode=outside, borderValue=np.nan)
        return np.asarray(straight, dtype=np.float32)


def lens_of(rs: Any, given: Any) -> Lens | None:
    """The undistortion of a stream's pictures, by librealsense's own model of its lens; None if not needed."""
    if given.model == rs.distortion.none or not any(given.coeffs):
        return None
    columns, rows = np.meshgrid(np.arange(given.width, dtype=float), np.arange(given.height, dtype=float))
    rays = np.stack([(columns - given.ppx) / given.fx, (rows - given.ppy) / given.fy, np.ones_like(rows)], -1)
    project = rs.rs2_project_point_to_pixel
    bent = np.array([project(given, ray) for ray in rays.reshape(-1, 3).tolist()]).reshape(*rows.shape, 2)
    if not np.isfinite(bent).all():
        raise RobotError(f"The camera reports an invalid lens: {given.model}, {list(given.coeffs)}.")
    if np.abs(bent - np.stack([columns, rows], -1)).max() < NEGLIGIBLE:
        return None
    return Lens(bent[..., 1].astype(np.float32), bent[..., 0].astype(np.float32))


@dataclass(frozen=True)
class ColourAxis:
    """Turns depths along the depth sensor's axis into depths along the colour camera's.

    With colour_from_depth = (R, t), a point z_c r on the ray r of a colour pixel has z_d = R_3 . (z_c r - t), where
    R_3 is the third column of R. ``shift`` is R_3 . t in metres, ``share`` (H, W) is R_3 . r.
    """

    shift: float
    share: FloatArray

    def depth(self, aligned: NDArray[np.float32]) -> NDArray[np.float32]:
        """Metres along the colour camera's z, (H, W); NaN stays NaN."""
        return ((aligned + self.shift) / self.share).astype(np.float32)


def colour_axis(extrinsics: Any, intrinsics: Intrinsics) -> ColourAxis:
    """For straight colour pictures of ``intrinsics``; ``extrinsics`` are librealsense's, from depth to colour."""
    column = np.array(extrinsics.rotation[6:9], dtype=np.float64)  # librealsense stores column after column
    u, v = np.meshgrid(np.arange(intrinsics.width) + 0.5, np.arange(intrinsics.height) + 0.5)
    rays = np.stack([(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy], -1)
    share = rays @ column[:2] + column[2]  # (H, W)
    return ColourAxis(float(column @ np.array(extrinsics.translation)), share)


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
        camera = replace(self.calibration, intrinsics=self.intrinsics).camera(
            f"realsense-{self.serial}", base_from_tcp
        )
        picture = self._stream.next(time.time(), self._timeout)
        image, depth = picture.image, picture.depth
        if self._lens is not None:
            image, depth = self._lens.image(image), self._lens.depth(depth)
        depth = self._axis.depth(depth)
        return CameraFrames((View(camera, image, depth),), (picture.exposed,))

    def close(self) -> None:
        """Stop streaming; safe to call twice."""
        self._stream.close()


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
    most = {"fx": wanted.fx, "fy": wanted.fy, "cx": wanted.width, "cy": wanted.height}
    off = [
        f"{name} {getattr(stream, name):.1f} for {getattr(wanted, name):.1f}"
        for name, by in most.items()
        if abs(getattr(stream, name) - getattr(wanted, name)) > TOLERANCE * by
    ]
    if off:
        raise RobotError(
            f"The camera '{calibration.serial}' has other intrinsics than its calibration {path} says: "
            f"{', '.join(off)} pixels. Calibrate again, in the mode that is to be used."
        )


def load() -> Any:
    """The module ``pyrealsense2``.

    Raises :class:`MissingDependencyError` when it, or its libusb, is missing.
    """
    try:  # so that pyrealsense2 finds libusb's symbols; without this package the system's own may still work
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    except (ImportError, OSError):
        pass
    try:
        import pyrealsense2
    except ImportError as error:
        missing = (
            "pyrealsense2"
            if error.name == "pyrealsense2"
            else f"a library that pyrealsense2 links to ({error})"
        )
        raise MissingDependencyError(
            missing, "camera=realsense", "pip install 'gvla2[realsense]'", "Apache-2.0"
        ) from error
    return pyrealsense2


def choose(rs: Any, devices: Sequence[Any], serial: str = "") -> Any:
    """The device of that serial, or the only one there is.

    Raises :class:`RobotError`, listing the connected ones.
    """
    found = {serial_of(rs, d): d for d in devices if name_of(rs, d) != "Platform Camera"}
    if serial in found or (len(found) == 1 and not serial):
        return found[serial or next(iter(found))]
    listing = ", ".join(f"{name_of(rs, device)} '{key}'" for key, device in found.items()) or "none"
    asked = f" with the serial '{serial}'" if serial else ""
    raise RobotError(
        f"librealsense finds no single camera{asked}; there is {listing}. Choose one by camera.serial=..., or plug it "
        "into a USB 3 port; on Linux, librealsense's udev rules give users access to it. L5xx and SR3xx cameras need "
        "pyrealsense2<2.55."
    )
