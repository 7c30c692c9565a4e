import numpy as np
import pytest
import trimesh

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.transform import rigid
from gvla2.robot.scan import Mesh, read_scan
from gvla2.robot.solids import extent, lowest
from tests.scanning import box, checkered, painted, write


def test_a_mesh_is_centred_and_measured(tmp_path):
    mesh = painted(box(0.06, 0.08, 0.1))
    mesh.apply_translation([0.3, 0, 0.05])
    scan = read_scan(write(tmp_path, "carton", mesh))
    np.testing.assert_allclose(scan.size, (0.06, 0.08, 0.1), atol=1e-6)
    np.testing.assert_allclose(scan.offset, (0.3, 0, 0.05), atol=1e-6)
    np.testing.assert_allclose(scan.textured.mesh.bounds.sum(axis=0), 0, atol=1e-9)
    assert scan.notes == ()
    assert scan.rgb[0] > scan.rgb[2]
    body = Mesh(tmp_path / "carton" / "textured.obj", mass=0.3, friction=0.5).body(
        "carton", rigid(translation=(0, 0, 1))
    )
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
    assert "read as millimetres" in scan.notes[0]
    assert read_scan(tmp_path / "carton" / f"textured.{suffix}", 0.001).notes == ()


def test_a_given_scale_is_kept_and_a_senseless_one_refused(tmp_path):
    path = write(tmp_path, "carton", painted(box(6, 8, 10)))
    assert read_scan(path, 0.01).size[2] == pytest.approx(0.1)
    with pytest.raises(ConfigurationError, match="10 m long"):
        read_scan(path, 1.0)
    with pytest.raises(ConfigurationError, match="positive"):
        read_scan(path, -1.0)
    with pytest.raises(ConfigurationError, match="mass=0"):
        Mesh(path, 0.01, mass=0).body("carton", np.eye(4))


def test_faces_that_look_inwards_are_turned(tmp_path):
    mesh = painted(box(0.06, 0.08, 0.1))
    inside_out = trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], visual=mesh.visual, process=False)
    scan = read_scan(write(tmp_path, "carton", inside_out))
    assert scan.textured.mesh.volume == pytest.approx(0.06 * 0.08 * 0.1, rel=1e-3)
    assert "negative" in scan.notes[0]
    same = read_scan(write(tmp_path, "other", mesh))
    np.testing.assert_allclose(scan.rgb, same.rgb, atol=1e-3)


def test_a_mesh_without_a_texture_is_grey_or_has_its_own_colour(tmp_path):
    grey = read_scan(write(tmp_path, "grey", trimesh.creation.box(extents=(0.1, 0.1, 0.1))))
    assert "no texture" in grey.notes[0]
    assert max(grey.rgb) - min(grey.rgb) < 0.05
    red = trimesh.creation.box(extents=(0.1, 0.1, 0.1))
    red.visual.vertex_colors = np.tile([200, 20, 20, 255], (len(red.vertices), 1)).astype(np.uint8)
    assert read_scan(write(tmp_path, "red", red, "glb")).rgb == pytest.approx(
        (200 / 255, 20 / 255, 20 / 255), abs=0.01
    )


def test_a_very_fine_mesh_is_thinned_and_keeps_its_colours(tmp_path, monkeypatch):
    most = 25_000
    monkeypatch.setattr("gvla2.robot.scan.MOST_FACES", most)
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.05)
    assert len(ball.faces) > 3 * most
    path = write(tmp_path, "ball", painted(ball, checkered(dark=(250, 0, 0), light=(0, 0, 250))), "glb")
    scan = read_scan(path)
    assert 0.3 * most < len(scan.textured.mesh.faces) <= most
    assert "simplified" in scan.notes[0]
    np.testing.assert_allclose(scan.size, (0.1, 0.1, 0.1), atol=0.002)
    red, _, blue = scan.face_colours.T
    assert (red > 0.8).mean() > 0.3
    assert (blue > 0.8).mean() > 0.3


def test_a_file_that_is_no_mesh_says_so(tmp_path):
    with pytest.raises(GeometryError, match="no such file"):
        read_scan(tmp_path / "absent.obj")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(GeometryError, match=r"empty\.obj"):
        read_scan(tmp_path / "empty.obj")


def test_vertices_that_no_face_uses_do_not_count(tmp_path):
    mesh = trimesh.creation.box((0.05, 0.05, 0.08))
    vertices = np.vstack([mesh.vertices, [[0.1, 0.2, 0.3], [0, 0, 0.5]]])
    path = tmp_path / "carton.ply"
    trimesh.Trimesh(vertices, mesh.faces, process=False).export(path)
    np.testing.assert_allclose(read_scan(path).size, (0.05, 0.05, 0.08), atol=1e-6)


def test_a_face_of_a_vertex_that_is_not_there_names_the_file(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    text += (
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99\n"
    )
    (tmp_path / "cut.ply").write_text(text)
    with pytest.raises(GeometryError, match=r"cut\.ply"):
        read_scan(tmp_path / "cut.ply")
