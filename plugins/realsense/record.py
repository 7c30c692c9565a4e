"""Record a camera's frames into a folder for ``camera=replay``: ``python -m gvla2_plugins.realsense.record``."""

from __future__ import annotations

import argparse
import io
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from gvla2.errors import Gvla2Error, OutputError
from gvla2.geometry.views import View
from gvla2.io.files import write_whole
from gvla2_plugins.realsense import RealsenseConfig
from gvla2_plugins.realsense.camera import RealsenseCamera


def record(camera: RealsenseCamera, folder: Path, frames: int, every: float) -> None:
    """Write ``frames`` frames, ``every`` seconds apart: NNN.rgb.png, NNN.depth.npy (metres), camera.json.

    A camera on the hand is recorded with the hand standing still. Raises :class:`OutputError` for a folder that is not
    empty, and :class:`RobotError` for camera failures; earlier frames are kept.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"The folder {folder} can't be used: {error.strerror}.") from error
    if taken:
        raise OutputError(f"The folder {folder} is not empty; choose a new or empty one.")
    replace(camera.calibration, intrinsics=camera.intrinsics).save(folder / "camera.json")
    for number in range(frames):
        if number:
            time.sleep(every)
        (view,) = camera.observe(np.eye(4)).views
        _write(view, folder / f"{number:03d}")


def _write(view: View, stem: Path) -> None:
    depth, colour = io.BytesIO(), io.BytesIO()
    np.save(depth, np.asarray(view.depth), allow_pickle=False)
    Image.fromarray(view.image).save(colour, format="png")
    write_whole(stem.with_suffix(".depth.npy"), depth.getvalue())
    write_whole(stem.with_suffix(".rgb.png"), colour.getvalue())


def main(argv: Sequence[str] | None = None, device: Any = None) -> int:
    """The command; returns 1 after an error, which is printed. ``device`` as in :class:`RealsenseCamera`."""
    parser = argparse.ArgumentParser(prog="python -m gvla2_plugins.realsense.record", description=__doc__)
    parser.add_argument("calibration", help="the camera's hand-eye file")
    parser.add_argument("folder", type=Path, help="where the frames go: a new folder")
    parser.add_argument("--frames", type=int, default=1, help="how many (1)")
    parser.add_argument("--every", type=float, default=0.5, help="seconds between two (0.5)")
    parser.add_argument("--serial", default="", help="which camera, where there are several")
    parser.add_argument("--fps", type=int, default=30, help="pictures a second that the camera takes (30)")
    asked = parser.parse_args(argv)
    config = RealsenseConfig(calibration=asked.calibration, serial=asked.serial, fps=asked.fps)
    try:
        camera = RealsenseCamera(config, device)
        try:
            record(camera, asked.folder, asked.frames, asked.every)
        finally:
            camera.close()
    except Gvla2Error as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{asked.frames} frames of camera '{camera.serial}' are in {asked.folder}.")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
