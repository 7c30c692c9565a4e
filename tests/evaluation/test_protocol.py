import numpy as np
import pytest

from gvla2.evaluation.protocol import FOCAL, TARGETS, object_views, protocol_cameras, textured_view
from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.transform import look_along


def test_cameras_follow_the_protocol():
    cameras = protocol_cameras("bowl", 256)
    assert len(cameras) == 25
    radii = np.array([np.linalg.norm(camera.position) for camera in cameras])
    assert 1.7 <= radii[0] <= 2.0
    assert 0.9 <= cameras[0].position[2] <= 1.1
    assert ((radii >= 1.5) & (radii <= 2.2)).all()
    for camera in cameras:
        uv, depth = camera.project(np.zeros(3))
        np.testing.assert_allclose(uv, [128, 128], atol=1e-9)
        assert depth == pytest.approx(np.linalg.norm(camera.position))
        assert camera.K[0, 0] == FOCAL * 256 == 1.09375 * 256
        assert camera.world_from_camera[2, 1] <= 1e-12, "the image's y axis points down"


def test_texture_lies_where_the_file_says(tmp_path, block):
    path = block(tmp_path / "cube", (1, 1, 1))
    textured = read_textured_mesh(path).normalised()
    assert len(textured.mesh.vertices) == 8, "vertices that the texture cuts apart count once"
    K = np.array([[60.0, 0, 32], [0, 60, 32], [0, 0, 1]])
    # The face z = +0.5 has corners 2 6 8 4 = (-,-) (+,-) (+,+) (-,+) with v = 1, the blue row, at y = +0.5.
    camera = Camera(K, look_along((0, 0, 2), (0, 0, -1), up=(0, 1, 0)), 64, 64)
    view = textured_view(textured, camera, 4)
    right = camera.world_from_camera[:3, 0]
    uv, _ = camera.project(np.array([[-0.3, 0, 0.5], [0.3, 0, 0.5], [0, 0.47, 0.5]]))
    red, green, blue = (view.image[int(v), int(u)].argmax() for u, v in uv)
    assert (red, green, blue) == (0, 1, 2)
    assert abs(right[0]) == pytest.approx(1)
    assert view.mask is not None
    assert view.depth is not None
    assert view.depth[32, 32] == pytest.approx(1.5, abs=1e-5)
    assert view.mask[32, 32] == 1
    assert view.mask[0, 0] == 0
    assert np.isnan(view.depth[0, 0])
    np.testing.assert_array_equal(view.image[0, 0], [255, 255, 255])


def test_alpha_is_soft_and_its_area_is_right(tmp_path, block):
    textured = read_textured_mesh(block(tmp_path / "cube", (1, 1, 1))).normalised()
    K = np.array([[50.3, 0, 32], [0, 50.3, 32], [0, 0, 1]])
    camera = Camera(K, look_along((2, 0, 0), (-1, 0, 0)), 64, 64)
    view = textured_view(textured, camera, 8)
    assert view.mask is not None
    side = 50.3 / 1.5
    assert view.mask.sum() == pytest.approx(side**2, rel=5e-3)
    assert ((view.mask > 0.02) & (view.mask < 0.98)).any()


def test_views_of_an_object_and_their_cache(tmp_path, block, own_cache):
    path = block(tmp_path / "box")
    first = object_views(path, size=48, samples=2)
    assert (first.name, len(first.inputs), len(first.targets)) == ("box", 5, 15)
    assert [view.name for view in first.targets] == [f"{n:03d}" for n in TARGETS]
    assert first.mesh is not None
    assert np.ptp(first.mesh.vertices, axis=0).max() == pytest.approx(1)
    np.testing.assert_allclose(first.mesh.bounds.mean(axis=0), 0, atol=1e-12)
    points = first.inputs[0].points()
    assert np.nanmax(np.abs(points)) <= 0.5 + 1e-5, "depth lies on the normalised object"

    (entry,) = (own_cache / "views").iterdir()
    stamp = entry.stat().st_mtime_ns
    again = object_views(path, size=48, samples=2)
    for one, other in zip((*first.inputs, *first.targets), (*again.inputs, *again.targets), strict=True):
        np.testing.assert_array_equal(one.image, other.image)
        np.testing.assert_array_equal(one.mask, other.mask)
        np.testing.assert_array_equal(one.depth, other.depth)
    assert entry.stat().st_mtime_ns == stamp, "read, not rendered again"

    block(tmp_path / "box", (0.2, 0.2, 0.05))
    assert object_views(path, size=48, samples=2).mesh.vertices[0, 1] != first.mesh.vertices[0, 1]
    assert len(list((own_cache / "views").iterdir())) == 2, "another content has another key"
