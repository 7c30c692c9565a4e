"""Recorded RGB-D frames in place of a camera: folders of pictures.

A folder of pictures is one camera's; or it has a folder of pictures for each of several cameras, named after them:

* ``000.rgb.png``, 8 bit colour, ``001.rgb.png``, ...
* ``000.depth.png``, 16 bit in units of ``depth_scale``; or ``000.depth.npy``, metres if it holds floats, else units
* ``camera.json``, the hand-eye calibration (docs/piper.md), and optionally ``depth_scale``, metres per unit (0.001 by
  default)

Depth is measured along the camera's z and aligned to the colour picture; 0 and NaN are where nothing was measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.backend import DepthCamera


@dataclass
class ReplayConfig(ComponentConfig):
    """Options of ``replay``.

    ``path`` is a folder of pictures. Each observation shows the next frame, and the last again at the end.
    """

    path: str = ""


def _build(config: ReplayConfig) -> DepthCamera:
    """Recorded RGB-D frames, from a folder of pictures, which shows no effect of motions."""
    from gvla2_plugins.replay_camera.camera import ReplayCamera

    return ReplayCamera(config)


@hookimpl
def gvla2_cameras() -> list[Component[DepthCamera]]:
    """``camera=replay camera.path=FOLDER``."""
    return [Component("replay", ReplayConfig, _build)]
