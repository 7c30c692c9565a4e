import numpy as np
import pytest
import trimesh

from gvla2.geometry.transform import rigid
from gvla2.robot.scan import read_scan, scanned_body
from gvla2.robot.solids import extent, lowest
from tests.scanning import box, painted, write


def test_a_mesh_is_centred_and_measured(tmp_path):
    mesh = painted(box(0.06, 0.08, 0.1))
    mesh.apply_translation([0.3, 0, 0.05])
    scan = read_scan(write(tmp_path, "carton", mesh))
    np.testing.assert_allclose(scan.size, (0.06, 0.08, 0.1), atol=1e-6)
    np.testing.assert_allclose(scan.offset, (0.3, 0, 0.05), atol=1e-6)
    np.testing.assert_allclose(scan.textured.mesh.bounds.sum(axis=0), 0, atol=1e-9)
    assert scan.rgb[0] > scan.rgb[2]
    path, pose = tmp_path / "carton" / "textured.obj", rigid(translation=(0, 0, 1))
    body = scanned_body(path, "carton", pose, mass=0.3, friction=0.5)
    assert (body.mass, body.friction, body.label) == (0.3, 0.5, "carton")
    assert lowest(body.solids[0], body.world_from_body) == pytest.approx(0.95)
    np.testing.assert_allclose(extent(body.solids), [[-0.03, -0.04, -0.05], [0.03, 0.04, 0.05]], atol=1e-6)


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_millimetres_are_found_out(tmp_path, suffix):
    mesh = painted(box(60, 80, 100))
    if suffix == "glb":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    scan = read_scan(write(tmp_path, "carton", mesh, suffix))
    np.testing.assert_allclose(scan.size, (0.06, 0.08, 0.1), atol=1e-6)
    np.testing.assert_array_equal(
        read_scan(tmp_path / "carton" / f"textured.{suffix}", 0.001).size, scan.size
    )


def test_a_mesh_without_a_texture_is_grey_or_has_its_own_colour(tmp_path):
    grey = read_scan(write(tmp_path, "grey", trimesh.creation.box(extents=(0.1, 0.1, 0.1))))
    assert max(grey.rgb) - min(grey.rgb) < 0.05
    red = trimesh.creation.box(extents=(0.1, 0.1, 0.1))
    red.visual.vertex_colors = np.tile([200, 20, 20, 255], (len(red.vertices), 1)).astype(np.uint8)
    assert read_scan(write(tmp_path, "red", red, "glb")).rgb == pytest.approx(
        (200 / 255, 20 / 255, 20 / 255), abs=0.01
    )
