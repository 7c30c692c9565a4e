"""What the compiled loops count, against arithmetic that is plain to read."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import invert_rigid, look_along, rigid, transform_points
from gvla2.perception.fitting import GAP, NEAR, SeenPoints, Sight, visible
from gvla2.perception.nearest import CELL, NearestPoints


def test_the_nearest_point_is_found_to_two_cells():
    rng = np.random.default_rng(0)
    points, queries = rng.uniform(0.0, 0.1, (400, 3)), rng.uniform(-0.02, 0.12, (2, 300, 3))
    away, index = NearestPoints(points, 0.02).query(queries)
    assert away.shape == index.shape == (2, 300)
    assert np.linalg.norm(queries - points[index], axis=-1) == pytest.approx(away)
    assert (away - cKDTree(points).query(queries)[0]).max() < 2 * CELL


def test_mean_distances_are_those_of_points_seen_from_each_pose():
    rng = np.random.default_rng(1)
    nearest, seen = NearestPoints(rng.uniform(0.0, 0.1, (400, 3)), 0.02), rng.uniform(0.0, 0.1, (60, 3))
    turns, shifts = Rotation.random(5, random_state=1).as_matrix(), rng.uniform(-0.05, 0.05, (5, 3))
    means = nearest.mean_distances(seen, turns, shifts, 0.01)
    for turn, shift, mean in zip(turns, shifts, means, strict=True):
        local = transform_points(invert_rigid(rigid(turn, shift)), seen)
        assert np.minimum(nearest.query(local)[0], 0.01).mean() == pytest.approx(mean)


@pytest.mark.parametrize(
    ("behind", "counted"), [(0.5 * NEAR, "shown"), (2 * GAP, "through"), (-GAP, "hidden")]
)
def test_cameras_show_look_through_or_do_not_see_a_surface(behind, counted):
    """A sheet that is turned and raised to 0.2 m faces one camera over it; what is measured lies behind it."""
    side = np.linspace(-0.05, 0.05, 11)
    sheet = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2) @ np.eye(2, 3)
    camera = Camera.from_fov(0.8, look_along([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]), 64, 48)
    depth = np.full((48, 64), 0.8 + behind)
    depth[:, :32] = np.nan  # nothing is measured where x is below 0
    sight = Sight(camera, depth, np.zeros((48, 64, 3)))
    seen = SeenPoints(sheet, sheet, [sight], 0.0)
    pose = rigid(Rotation.from_euler("z", 90, degrees=True).as_matrix(), [0.001, 0.0007, 0.2])
    up = np.tile([0.0, 0.0, 1.0], (len(sheet), 1))
    shown, through, (where,) = visible(sheet, up, pose, seen)
    measured = np.flatnonzero(sheet[:, 1] < 0.0005)  # turned by 90 degrees, -y becomes x
    assert (shown, through) == (66 * (counted == "shown"), 66 * (counted == "through"))
    assert len(measured) == 66
    if counted == "shown":
        assert where[0].tolist() == measured.tolist()
        uv = camera.project(transform_points(pose, sheet[measured]))[0]
        assert (np.floor(uv) == where[:0:-1].T).all()
    assert visible(sheet, -up, pose, seen)[:2] == (0, 0)
