"""Recorded RGB-D frames in place of a camera: numbered folders of views, as a run leaves them under ``views``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.backend import DepthCamera


@dataclass
class ReplayConfig(ComponentConfig):
    """Options of ``replay``.

    ``path`` is a folder of views with depth (``cameras.json``, ``images``, ``depth``), or a folder of such folders,
    ``000``, ``001``, ..., one a frame; a run's folder is a recording of one frame. Each observation shows the next
    frame, and the last again at the end.
    """

    path: str = ""


def _build(config: ReplayConfig) -> DepthCamera:
    """Recorded RGB-D frames, from folders of views, which show no effect of motions."""
    from gvla2_plugins.replay_camera.camera import ReplayCamera

    return ReplayCamera(config)


@hookimpl
def gvla2_cameras() -> list[Component[DepthCamera]]:
    """``camera=replay camera.path=FOLDER``."""
    return [Component("replay", ReplayConfig, _build)]
