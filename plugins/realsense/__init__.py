"""A depth camera that librealsense drives: aligned depth in metres, placed by its hand-eye calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.backend import DepthCamera


@dataclass
class RealsenseConfig(ComponentConfig):
    """Options of ``realsense``.

    ``calibration`` is the hand-eye file (docs/piper.md); required, and the pictures get its size. ``serial`` is
    needed only where several cameras are plugged in and the file's is not to be used. ``fps`` is pictures per second.
    ``warm_up`` pictures are dropped at the start, while the exposure settles. ``timeout`` is how long to wait for a
    picture, seconds.
    """

    calibration: str = ""
    serial: str = ""
    fps: int = 30
    warm_up: int = 30
    timeout: float = 5.0


def _build(config: RealsenseConfig) -> DepthCamera:
    """Intel's RealSense and other librealsense depth cameras: live colour with aligned depth."""
    from gvla2_plugins.realsense.camera import RealsenseCamera

    return RealsenseCamera(config)


@hookimpl
def gvla2_cameras() -> list[Component[DepthCamera]]:
    """``camera=realsense camera.calibration=hand_eye.json``."""
    return [Component("realsense", RealsenseConfig, _build)]
