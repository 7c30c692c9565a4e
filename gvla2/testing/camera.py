"""Conformance of depth cameras."""

from __future__ import annotations

import numpy as np

from gvla2.robot.backend import CameraFrames, DepthCamera
from gvla2.testing.conformance import allowed, require, require_members, require_rigid, require_type


def check_camera(camera: DepthCamera) -> None:
    """Frames are RGB-D in metres, rigidly placed, timestamped, and new for each call; closing twice is allowed."""
    require_members(camera, "camera")
    with allowed("observe()"):
        first = camera.observe(np.eye(4))
    with allowed("observe() without the tool's pose"):
        second = camera.observe()
    for frames in (first, second):
        require_type(frames, CameraFrames, "observe()")
        for view, stamp in zip(frames.views, frames.timestamps, strict=True):
            require_rigid(view.camera.world_from_camera, f"The pose of the view '{view.name}'")
            require(view.depth is not None, f"The view '{view.name}' has no depth.")
            assert view.depth is not None
            known = view.depth[np.isfinite(view.depth)]
            require(
                bool((known > 0).all() and (known < 100).all()),
                f"The depth of '{view.name}' is not in metres: values outside (0, 100).",
            )
            require(bool(np.isfinite(stamp)) and stamp > 0, f"The timestamp of '{view.name}' is {stamp}.")
    require(
        [v.name for v in first.views] == [v.name for v in second.views],
        "Two observations must have the same views in the same order.",
    )
    require(
        all(b >= a for a, b in zip(first.timestamps, second.timestamps, strict=True)),
        "A later observation has earlier timestamps.",
    )
    with allowed("close(), twice"):
        camera.close()
        camera.close()
