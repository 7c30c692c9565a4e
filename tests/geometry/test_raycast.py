from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import invert_rigid, look_along, rigid

GREEN = (0.2, 0.8, 0.3)


def box(extents: tuple[float, float, float], rgb: tuple[float, float, float] = GREEN, id: int = 0) -> Surface:
    mesh = trimesh.creation.box(extents)
    return Surface(mesh.vertices, mesh.faces, rgb, id)


def camera_at(distance: float, size: int = 48, fov: float = 0.6) -> Camera:
    return Camera.from_fov(fov, look_along((-distance, 0, 0), (1, 0, 0)), size, size)


def box_depth(camera: Camera, half: np.ndarray, world_from_box: np.ndarray) -> np.ndarray:
    """Analytic depth by the slab method, NaN where the box is missed."""
    box_from_world = invert_rigid(world_from_box)
    origin, directions = camera.rays()
    o = box_from_world[:3, :3] @ origin + box_from_world[:3, 3]
    d = directions @ box_from_world[:3, :3].T
    a, b = (-half - o) / d, (half - o) / d
    enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    return np.where((enter <= leave) & (enter > 0), enter, np.nan)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_depth_of_a_posed_box_is_the_analytic_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    extents = rng.uniform(0.1, 0.6, 3)
    pose = rigid(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.3, 0.3, 3))
    camera = camera_at(2.0)
    [seen] = RayCaster([box(tuple(extents))]).cast([camera], {0: pose})
    expected = box_depth(camera, extents / 2, pose)
    both = np.isfinite(seen.depth) & np.isfinite(expected)
    assert np.abs(seen.depth - expected)[both].max(initial=0.0) < 1e-4
    # Only rays that graze an edge within a float's precision may differ in whether they hit.
    assert (np.isfinite(seen.depth) != np.isfinite(expected)).mean() < 2e-3


def test_the_nearest_surface_wins_whatever_the_order() -> None:
    near, far = box((0.1, 0.2, 0.2), id=3), box((0.1, 1.0, 1.0), id=4)
    poses = {"near": rigid(translation=(-0.5, 0, 0)), "far": rigid(translation=(0.5, 0, 0))}
    [one] = RayCaster([near, far]).cast([camera_at(2.0)], {0: poses["near"], 1: poses["far"]})
    [two] = RayCaster([far, near]).cast([camera_at(2.0)], {0: poses["far"], 1: poses["near"]})
    assert np.array_equal(one.ids, two.ids)
    assert one.ids[24, 24] == 3
    assert set(np.unique(one.ids)) == {-1, 3, 4}
    assert one.depth[24, 24] == pytest.approx(1.45, abs=1e-5)


def test_a_view_of_nothing_is_all_nan_and_background() -> None:
    for surfaces in (
        [],
        [box((0.1, 0.1, 0.1))],
        [Surface(np.zeros((0, 3)), np.zeros((0, 3), int), GREEN, 1)],
    ):
        caster = RayCaster(surfaces, background=(1.0, 0.0, 0.5))
        poses = {0: rigid(translation=(-9.0, 0, 0))} if surfaces else {}  # behind the camera
        [seen] = caster.cast([camera_at(2.0)], poses)
        assert np.isnan(seen.depth).all()
        assert (seen.ids == -1).all()
        assert (seen.image == [255, 0, 128]).all()


def test_a_surface_that_crosses_the_camera_plane_is_seen() -> None:
    camera = camera_at(1.0)
    pose = rigid(translation=(0, 0.113, -0.207))
    [seen] = RayCaster([box((6, 0.1, 0.1))]).cast([camera], {0: pose})
    expected = box_depth(camera, np.array([3, 0.05, 0.05]), pose)
    assert np.isfinite(expected).sum() > 5
    assert (np.isfinite(seen.depth) != np.isfinite(expected)).mean() < 2e-3


@pytest.mark.parametrize("rgb", [(0.9, 0.1, 0.1), (0.5, 0.5, 0.5)])
def test_light_changes_brightness_and_never_hue(rgb: tuple[float, float, float]) -> None:
    camera = Camera.from_fov(0.6, look_along((-1, -0.8, 0.7), (1, 0.8, -0.7)), 64, 64)
    [seen] = RayCaster([box((0.3, 0.3, 0.3), rgb)]).cast([camera], {})
    shades = np.unique(seen.image[seen.ids == 0], axis=0).astype(float)
    assert len(shades) == 3  # three faces, told apart
    gains = shades / (255 * np.array(rgb))
    assert np.ptp(gains, axis=1).max() < 0.5 / (255 * min(rgb)) * 2 + 1e-9  # rounding alone
    assert gains.min() > 0.54
    assert gains.max() < 1.0 + 1e-2


@pytest.mark.parametrize("distance", [0.7, 1.3, 2.9])
def test_no_ray_slips_between_the_triangles_of_a_surface(distance: float) -> None:
    # Square on, the diagonal of the face runs exactly through the centres of pixels.
    [seen] = RayCaster([box((0.2, 0.9, 0.9))]).cast([camera_at(distance, 64)], {})
    hit = np.isfinite(seen.depth)
    rows, columns = np.flatnonzero(hit.any(axis=1)), np.flatnonzero(hit.any(axis=0))
    assert hit[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()
    assert np.allclose(seen.depth[hit], distance - 0.1, atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vertices": np.full((3, 3), np.nan)}, "not finite"),
        ({"vertices": np.zeros((3, 2))}, "vertices"),
        ({"faces": np.array([[0, 1, 3]])}, "names a vertex"),
        ({"rgb": (0.0, 0.0, 2.0)}, "rgb"),
        ({"rgb": np.zeros((2, 3))}, "rgb"),
        ({"id": -1}, "background"),
    ],
)
def test_malformed_surfaces_are_refused(changes: dict[str, object], words: str) -> None:
    good = {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "rgb": GREEN, "id": 0}
    with pytest.raises(GeometryError, match=words):
        Surface(**{**good, **changes})


def test_poses_are_checked() -> None:
    caster = RayCaster([box((1, 1, 1))])
    with pytest.raises(GeometryError, match=r"surfaces \[1\].*there are 1"):
        caster.cast([], {1: np.eye(4)})
    with pytest.raises(GeometryError, match="mirrored"):
        caster.cast([], {0: np.diag([1.0, 1, -1, 1])})
