"""A software camera: given pictures, sent through librealsense like a device's own."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2_plugins.realsense.camera import load


@dataclass
class Optics:
    """One sensor: ``width`` x ``height`` pixels, focal length ``f``, the principal point in the middle.

    ``model`` is the name of one of librealsense's distortions, ``coeffs`` its five numbers.
    """

    width: int
    height: int
    f: float
    model: str = "none"
    coeffs: tuple[float, ...] = (0.0,) * 5

    def intrinsics(self, rs: Any) -> Any:
        """In librealsense's format."""
        made = rs.intrinsics()
        made.width, made.height, made.fx, made.fy = self.width, self.height, self.f, self.f
        made.ppx, made.ppy = 0.5 * self.width - 0.5, 0.5 * self.height - 0.5
        made.model, made.coeffs = getattr(rs.distortion, self.model), list(self.coeffs)
        return made


@dataclass
class SoftwareCamera:
    """Sends its two pictures ``fps`` times a second once :meth:`start` was called, until :meth:`stop`.

    ``image`` (H, W, 3) uint8 and ``depth`` (H, W) uint16, in ``unit`` metres, may be changed at any time.
    ``colour_from_depth`` is where the depth sensor sits seen from the colour camera (metres; None for a device that
    does not say), and ``tilt`` its turn about y, radians. ``plugged`` is the device's connection state; ``sends`` are
    the active streams; ``counting`` is whether frames get new numbers; ``other_size`` sends depth of
    half the requested size.
    """

    serial: str = "f0123"
    name: str = "Intel RealSense D435"
    colour: Optics = field(default_factory=lambda: Optics(64, 48, 60.0))
    eye: Optics = field(default_factory=lambda: Optics(64, 48, 60.0))
    unit: float = 0.001
    fps: int = 30
    colour_from_depth: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    tilt: float = 0.0
    plugged: bool = True
    counting: bool = True
    other_size: bool = False
    sends: tuple[str, ...] = ("depth", "colour")

    def __post_init__(self) -> None:
        rs = self._rs = load()
        owner = self

        class Device(rs.software_device):  # type: ignore[misc, name-defined]
            def is_connected(self) -> bool:
                return owner.plugged

        self.device = Device()
        self.device.register_info(rs.camera_info.name, self.name)
        self.device.register_info(rs.camera_info.serial_number, self.serial)
        self.image = np.zeros((self.colour.height, self.colour.width, 3), np.uint8)
        self.depth = np.zeros((self.eye.height, self.eye.width), np.uint16)
        self._sensors: dict[str, Any] = {}
        self._profiles: dict[str, Any] = {}
        half = Optics(self.eye.width // 2, self.eye.height // 2, self.eye.f / 2)
        self._add("depth", "Stereo Module", self.eye, rs.stream.depth, rs.format.z16, 2)
        self._add("half", "Stereo Module", half, rs.stream.depth, rs.format.z16, 2)
        self._add("colour", "RGB Camera", self.colour, rs.stream.color, rs.format.rgb8, 3)
        self._sensors["depth"].add_read_only_option(rs.option.depth_units, self.unit)
        if self.colour_from_depth is not None:
            offset = rs.extrinsics()
            cos, sin = np.cos(self.tilt), np.sin(self.tilt)
            offset.rotation = [cos, 0.0, -sin, 0.0, 1.0, 0.0, sin, 0.0, cos]  # column after column
            offset.translation = list(self.colour_from_depth)
            for key in ("depth", "half"):
                self._profiles[key].register_extrinsics_to(self._profiles["colour"], offset)
        self.device.create_matcher(rs.matchers.dlr_c)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._number = 0

    def start(self) -> SoftwareCamera:
        """Start sending; frames without an open stream are lost, as from a real sensor."""
        self._stop.clear()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()
        return self

    def stop(self) -> None:
        """Send no more; safe to call twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _add(self, key: str, sensor: str, optics: Optics, kind: Any, fmt: Any, bytes_a_pixel: int) -> None:
        rs = self._rs
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.index = kind, fmt, 0
        stream.uid, stream.fps, stream.bpp = len(self._profiles) + 1, self.fps, bytes_a_pixel
        stream.width, stream.height = optics.width, optics.height
        stream.intrinsics = optics.intrinsics(rs)
        same = self._sensors["depth"] if key == "half" else self.device.add_sensor(sensor)
        self._sensors[key] = same
        self._profiles[key] = same.add_video_stream(stream)

    def _send(self) -> None:
        while not self._stop.wait(1.0 / self.fps):
            self._number += self.counting
            if "depth" in self.sends:
                key = "half" if self.other_size else "depth"
                self._send_one(key, self.depth[::2, ::2] if self.other_size else self.depth)
            if "colour" in self.sends:
                self._send_one("colour", self.image)

    def _send_one(self, key: str, pixels: NDArray[Any]) -> None:
        rs = self._rs
        frame = rs.software_video_frame()
        frame.pixels = np.ascontiguousarray(pixels)
        frame.bpp = pixels.itemsize * (pixels.shape[2] if pixels.ndim == 3 else 1)
        frame.stride = frame.bpp * pixels.shape[1]
        frame.timestamp = 1e3 * time.time()
        frame.domain = rs.timestamp_domain.system_time
        frame.frame_number = self._number
        frame.profile = self._profiles[key].as_video_stream_profile()
        if key != "colour":
            frame.depth_units = self.unit
        self._sensors[key].on_video_frame(frame)
