from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import look_along, rigid, transform_points

seeds = st.integers(0, 2**32 - 1)


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return rigid(Rotation.random(rng=rng).as_matrix(), rng.uniform(-2, 2, 3))


def random_camera(rng: np.random.Generator) -> Camera:
    width, height = rng.integers(8, 40, 2)
    fx, fy = rng.uniform(10, 80, 2)
    K = np.array([[fx, rng.normal(), rng.uniform(2, 30)], [0, fy, rng.uniform(2, 30)], [0, 0, 1]])
    return Camera(K, random_pose(rng), int(width), int(height))


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_backprojected_pixels_project_back_to_their_centres(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    depth = rng.uniform(0.1, 5, (camera.height, camera.width))
    uv, z = camera.project(camera.backproject(depth))
    assert np.allclose(uv, camera.pixel_centres(), atol=1e-7)
    assert np.allclose(z, depth)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_moving_camera_and_points_together_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera, motion = random_camera(rng), random_pose(rng)
    points = camera.backproject(rng.uniform(0.1, 5, (camera.height, camera.width))).reshape(-1, 3)
    moved = Camera(camera.K, motion @ camera.world_from_camera, camera.width, camera.height)
    for before, after in zip(
        camera.project(points), moved.project(transform_points(motion, points)), strict=True
    ):
        assert np.allclose(before, after, atol=1e-6)


def test_points_behind_the_camera_have_no_pixel() -> None:
    camera = Camera.from_fov(1.0, np.eye(4), 10, 10)
    uv, depth = camera.project(np.array([[0.0, 0, -1], [0, 0, 0], [0, 0, 1]]))
    assert np.isnan(uv[:2]).all()
    assert np.allclose(uv[2], [5, 5])
    assert depth.tolist() == [-1, 0, 1]
    assert camera.inside(uv).tolist() == [False, False, True]


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_look_along_points_the_axis_and_keeps_up_on_top(seed: int) -> None:
    rng = np.random.default_rng(seed)
    forward, position = rng.normal(size=3), rng.normal(size=3)
    pose = look_along(position, forward)
    assert np.allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-9)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert np.allclose(pose[:3, 2], forward / np.linalg.norm(forward))
    assert pose[2, 1] <= 1e-9  # image y goes down, so its world z is not positive


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (np.diag([1.0, 1, -1, 1]), "mirrored"),
        (np.diag([2.0, 2, 2, 1]), "orthonormal"),
        (np.full((4, 4), np.nan), "finite"),
        (np.eye(3), "4x4"),
    ],
)
def test_a_pose_that_is_not_rigid_is_refused(pose: np.ndarray, words: str) -> None:
    with pytest.raises(GeometryError, match=words):
        Camera.from_fov(1.0, pose, 4, 4)


@pytest.mark.parametrize("K", [np.zeros((3, 3)), np.diag([-1.0, 1, 1]), np.full((3, 3), np.nan), np.eye(2)])
def test_a_singular_or_malformed_intrinsic_matrix_is_refused(K: np.ndarray) -> None:
    with pytest.raises(GeometryError, match="K"):
        Camera(K, np.eye(4), 4, 4)
