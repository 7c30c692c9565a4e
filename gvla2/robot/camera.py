"""The contract of depth cameras that stand beside a real robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View


@dataclass(frozen=True)
class CameraFrames:
    """The cameras' frames of one moment.

    ``views`` are RGB-D: depth in metres along the camera's z, aligned to the colour image, NaN where nothing was
    measured; each view's ``camera.world_from_camera`` is its pose in the robot's *base* frame (the robot moves it on
    into the world). ``timestamps`` are the moments of exposure, one per view, seconds of ``time.time()``.
    ``camera=none`` gives no views. Raises :class:`RobotError` when the two differ in number.
    """

    views: tuple[View, ...]
    timestamps: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.views) != len(self.timestamps):
            raise RobotError(
                f"A camera gave {len(self.views)} views and {len(self.timestamps)} timestamps; each view has one."
            )


class DepthCamera(Protocol):
    """One or several calibrated depth cameras, live or recorded.

    ``observe`` may be called any number of times; ``close`` twice. A camera that was unplugged, is frozen, or gives
    images of a different size than its calibration's raises :class:`gvla2.errors.RobotError`, naming it.
    """

    @property
    def live(self) -> bool:
        """Whether it shows the present; a real arm does not move by recorded or synthetic pictures."""
        ...

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """Frames taken after the call began. A camera on the hand needs the tool's pose ``base_from_tcp`` (4, 4)."""
        ...

    def close(self) -> None:
        """Release the device or the files."""
        ...
