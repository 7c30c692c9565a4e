from __future__ import annotations

import numpy as np
import pytest

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import View

CAMERA = Camera.from_fov(1.0, np.eye(4), 4, 3, name="front")
IMAGE = np.zeros((3, 4, 3), dtype=np.uint8)


def test_points_are_where_depth_says_and_nan_elsewhere() -> None:
    depth = np.full((3, 4), 2.0, dtype=np.float32)
    depth[0, 0] = np.nan
    points = View(CAMERA, IMAGE, depth).points()
    assert np.isnan(points[0, 0]).all()
    assert np.allclose(points[..., 2].ravel()[1:], 2.0)


@pytest.mark.parametrize("what", ["depth", "mask", "robot_mask"])
def test_sizes_must_agree_with_the_camera(what: str) -> None:
    with pytest.raises(GeometryError, match=rf"front.*{what}"):
        View(CAMERA, IMAGE, **{what: np.zeros((4, 3))})


def test_points_of_a_colour_camera_are_refused() -> None:
    with pytest.raises(GeometryError, match="no depth"):
        View(CAMERA, IMAGE).points()
