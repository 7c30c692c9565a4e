"""Colour and depth of one device, running: pairs of one moment, depth aligned to the colour picture."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import RobotError


def choose_profiles(rs: Any, device: Any, size: tuple[int, int], fps: int) -> dict[str, tuple[Any, Any]]:
    """Sensor and profile of ``colour`` (RGB or BGR, 8 bit) of exactly ``size`` (width, height), and of ``depth``
    (16 bit) of the size nearest to it.

    Raises :class:`RobotError`, listing the device's streams.
    """
    who = f"The camera {name_of(rs, device)} '{serial_of(rs, device)}'"
    offers = [(sensor, p) for sensor in device.query_sensors() for p in sensor.get_stream_profiles()]
    formats = {
        "depth": (rs.stream.depth, (rs.format.z16,)), "colour": (rs.stream.color, (rs.format.rgb8, rs.format.bgr8)),
    }  # fmt: skip

    def distance(offer: tuple[Any, Any]) -> int:
        width, height = _size(offer[1])
        return abs(width - size[0]) + abs(height - size[1])

    chosen = {}
    for what, (stream, kinds) in formats.items():
        found = [(s, p) for s, p in offers if p.stream_type() == stream and p.format() in kinds]
        if not found:
            raise RobotError(f"{who} has no {what} stream: it is not an RGB-D camera.")
        fit = min((offer for offer in found if offer[1].fps() == fps), key=distance, default=None)
        if fit is None or (what == "colour" and distance(fit) > 0):
            have = ", ".join(sorted({"{}x{}@{}".format(*_size(p), p.fps()) for _, p in found}))
            raise RobotError(
                f"{who} has no {what} of {size[0]}x{size[1]} at {fps} a second; it has {have}. The colour's size is "
                "the calibration's. A USB 3 port offers more than USB 2."
            )
        chosen[what] = fit
    return chosen


_SLICE_MS = 250
"""Longest single wait: in between, Ctrl-C and the connection are checked."""

_TRUSTED = 1.0
"""Seconds; a picture's timestamp further from now is from another clock, or one that was reset."""


@dataclass(frozen=True)
class Picture:
    """``image`` (H, W, 3) uint8 RGB; ``depth`` (H, W) float32 metres along the depth sensor's axis, NaN unknown.

    ``exposed`` is when, in ``time.time()``.
    """

    image: NDArray[np.uint8]
    depth: NDArray[np.float32]
    exposed: float


class Stream:
    """Opens and starts the sensors of ``device``; any librealsense device works, ``rs.software_device`` too.

    ``size`` is width and height of the colour picture; ``intrinsics`` are that stream's, ``extrinsics`` from depth to
    colour. Raises :class:`RobotError` when the device has no such streams, or they can't be started.
    """

    def __init__(
        self,
        rs: Any,
        device: Any,
        size: tuple[int, int],
        fps: int = 30,
    ) -> None:
        self._rs, self._device = rs, device
        self.name = f"{name_of(rs, device)} '{serial_of(rs, device)}'"
        chosen = choose_profiles(rs, device, size, fps)
        colour, depth = chosen["colour"][1], chosen["depth"][1]
        self._sizes = [_size(colour), _size(depth)]
        self._swap = colour.format() == rs.format.bgr8
        self._period = 1.0 / max(1, fps)
        self.intrinsics = colour.as_video_stream_profile().get_intrinsics()
        try:
            self.extrinsics = depth.get_extrinsics_to(colour)
        except RuntimeError as error:
            raise RobotError(
                f"The camera {self.name} does not say how its two sensors stand to each other, so that depth can't be "
                f"aligned to colour: {error}"
            ) from error
        by_sensor: dict[str, tuple[Any, list[Any]]] = {}  # some have one sensor for both
        for sensor, profile in chosen.values():
            by_sensor.setdefault(_info(sensor, rs.camera_info.name), (sensor, []))[1].append(profile)
        self._align = rs.align(rs.stream.color)
        self._queue = rs.syncer()
        self._running: list[Any] = []
        self._last = [-1, -1]
        try:
            for sensor, profiles in by_sensor.values():
                sensor.open(profiles)
                self._running.append(sensor)
                sensor.start(self._queue)
        except RuntimeError as error:
            self.close()
            raise RobotError(f"The camera {self.name} can't be started: {error}.") from error

    def next(self, began: float, timeout: float) -> Picture:
        """The first pair that was exposed after ``began`` (``time.time()``), within ``timeout`` seconds.

        Raises :class:`RobotError` for a camera that was closed or unplugged, or gives no new pair of the size it began
        with.
        """
        if not self._running:
            raise RobotError(f"The camera {self.name} is closed.")
        deadline = time.monotonic() + timeout
        try:
            while time.monotonic() < deadline:
                waited, frames = self._queue.try_wait_for_frames(_SLICE_MS)
                arrived = time.time()
                if not waited:
                    self._check_plug()
                    continue
                pair = (frames.get_color_frame(), frames.get_depth_frame())
                if not all(pair) or not self._advanced(pair):
                    continue
                exposed = min(self._exposed(frame, arrived) for frame in pair)
                if exposed >= began and [(f.get_width(), f.get_height()) for f in pair] == self._sizes:
                    return self._picture(frames, exposed)
        except RuntimeError as error:  # the only type that librealsense raises
            self._check_plug()
            raise RobotError(f"The camera {self.name} failed: {error}.") from error
        self._check_plug()
        raise RobotError(
            f"The camera {self.name} gave no new pair of colour and depth within {timeout:g} s. Is its cable firm?"
        )

    def close(self) -> None:
        """Stop the sensors; safe to call twice, and after the plug was pulled."""
        for sensor in reversed(self._running):
            for end in (sensor.stop, sensor.close):
                try:
                    end()
                except RuntimeError:
                    continue  # never started, or unplugged: nothing to stop
        self._running = []

    def _check_plug(self) -> None:
        if not self._device.is_connected():
            raise RobotError(f"The camera {self.name} was unplugged.")

    def _advanced(self, pair: Sequence[Any]) -> bool:
        """Whether both frames are new: a frozen camera repeats old ones."""
        numbers = [frame.get_frame_number() for frame in pair]
        fresh = all(new != old for new, old in zip(numbers, self._last, strict=True))
        self._last = numbers if fresh else self._last
        return fresh

    def _exposed(self, frame: Any, arrived: float) -> float:
        """When the picture was taken: its timestamp if on this computer's clock, else a period before it arrived."""
        stamp = frame.get_timestamp() / 1e3
        own = frame.get_frame_timestamp_domain() != self._rs.timestamp_domain.hardware_clock
        return float(
            min(stamp, arrived) if own and abs(arrived - stamp) < _TRUSTED else arrived - self._period
        )

    def _picture(self, frames: Any, exposed: float) -> Picture:
        aligned = self._align.process(frames)
        colour, depth = aligned.get_color_frame(), aligned.get_depth_frame()
        unit = depth.get_units()  # metres
        if not 0.0 < unit < 1.0:
            raise RobotError(f"The camera {self.name} says that its unit of depth is {unit} m.")
        metres = np.asanyarray(depth.get_data()).astype(np.float32) * np.float32(unit)
        image = np.array(np.asanyarray(colour.get_data())[..., :3])  # a copy: the frame's memory goes back
        return Picture(
            np.ascontiguousarray(image[..., ::-1]) if self._swap else image,
            np.where(metres > 0, metres, np.float32(np.nan)),
            exposed,
        )


def _size(profile: Any) -> tuple[int, int]:
    video = profile.as_video_stream_profile()
    return video.width(), video.height()


def serial_of(rs: Any, device: Any) -> str:
    """The device's serial number, "" for a device that has none."""
    return _info(device, rs.camera_info.serial_number)


def name_of(rs: Any, device: Any) -> str:
    """The maker's name for it."""
    return _info(device, rs.camera_info.name) or "a camera without a name"


def _info(device: Any, what: Any) -> str:
    return str(device.get_info(what)) if device.supports(what) else ""
