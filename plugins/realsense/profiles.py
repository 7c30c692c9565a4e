"""Choosing among the streams of a device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gvla2.errors import RobotError
from gvla2_plugins.realsense.attached import link_note, name_of, serial_of


@dataclass(frozen=True)
class Chosen:
    """The two profiles, and what to open on each sensor: some have one sensor for both."""

    colour: Any
    depth: Any
    by_sensor: tuple[tuple[Any, list[Any]], ...]


def choose_profiles(
    rs: Any, device: Any, size: tuple[int, int], depth_size: tuple[int, int], fps: int
) -> Chosen:
    """Colour (RGB or BGR, 8 bit) of exactly ``size`` (width, height), and depth (16 bit) of ``depth_size``.

    A depth size of (0, 0) takes the nearest to the colour's. Raises :class:`RobotError`, listing the device's streams.
    """
    offers = [(sensor, p) for sensor in device.query_sensors() for p in sensor.get_stream_profiles()]
    video = [(sensor, p) for sensor, p in offers if p.is_video_stream_profile()]
    colours = [
        (s, p)
        for s, p in video
        if p.stream_type() == rs.stream.color and p.format() in (rs.format.rgb8, rs.format.bgr8)
    ]
    depths = [(s, p) for s, p in video if p.stream_type() == rs.stream.depth and p.format() == rs.format.z16]
    who = f"The camera {name_of(rs, device)} '{serial_of(rs, device)}'"
    for what, found in (("depth", depths), ("colour", colours)):
        if not found:
            raise RobotError(f"{who} has no {what} stream: it is not an RGB-D camera.{link_note(rs, device)}")
    colour = _pick(colours, size, fps)
    exact = depth_size != (0, 0)
    depth = _pick(depths, depth_size, fps) if exact else _nearest(depths, size, fps)
    for what, picked, found, wish in (
        ("colour", colour, colours, size),
        ("depth", depth, depths, depth_size if exact else size),
    ):
        if picked is None:
            have = ", ".join(sorted({"{}x{}@{}".format(*_key(p)) for _, p in found}))
            raise RobotError(
                f"{who} has no {what} of {wish[0]}x{wish[1]} at {fps} a second; it has {have}. "
                f"The colour's size is the calibration's.{link_note(rs, device)}"
            )
    assert colour is not None
    assert depth is not None
    if colour[0] is depth[0] or _name(rs, colour[0]) == _name(rs, depth[0]):
        return Chosen(colour[1], depth[1], ((depth[0], [depth[1], colour[1]]),))
    return Chosen(colour[1], depth[1], ((depth[0], [depth[1]]), (colour[0], [colour[1]])))


def _pick(found: list[Any], size: tuple[int, int], fps: int) -> Any | None:
    return next((pair for pair in found if _key(pair[1]) == (*size, fps)), None)


def _nearest(found: list[Any], size: tuple[int, int], fps: int) -> Any | None:
    def distance(pair: Any) -> int:
        width, height, _ = _key(pair[1])
        return abs(width - size[0]) + abs(height - size[1])

    return min((pair for pair in found if _key(pair[1])[2] == fps), key=distance, default=None)


def _key(profile: Any) -> tuple[int, int, int]:
    video = profile.as_video_stream_profile()
    return video.width(), video.height(), profile.fps()


def _name(rs: Any, sensor: Any) -> str:
    return str(sensor.get_info(rs.camera_info.name))
