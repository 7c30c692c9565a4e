import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import write_gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import write_mesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.rasteriser import Rasteriser
from gvla2.reconstruction.surfels import surfels
from gvla2_plugins.geofuse import ResultTreeConfig, gvla2_reconstructors
from gvla2_plugins.geofuse.results import place_gaussians, place_mesh
from tests.similarities import moved_poses, similarity

BUILD = next(c.build for c in gvla2_reconstructors() if c.name == "result_tree")


@pytest.fixture(scope="module")
def shape() -> TriangleMesh:
    """No symmetry: a long body, a fin and a foot."""
    parts = [
        trimesh.creation.box((0.9, 0.35, 0.2)),
        trimesh.creation.box((0.25, 0.1, 0.5)).apply_translation([0.25, 0, 0.2]),
        trimesh.creation.cylinder(0.1, 0.5, sections=24).apply_translation([-0.3, 0.2, -0.1]),
    ]
    whole = trimesh.util.concatenate(parts).subdivide()
    rng = np.random.default_rng(0)
    return TriangleMesh(
        whole.vertices, whole.faces, np.clip(0.6 + 0.1 * rng.normal(size=whole.vertices.shape), 0, 1)
    )


@pytest.fixture(scope="module")
def views(shape) -> Views:
    caster = RayCaster([Surface(shape.vertices, shape.faces, np.array([0.6, 0.5, 0.4]), 0)])
    rng = np.random.default_rng(2)
    made = []
    for i in range(5):
        direction = rng.normal(size=3)
        position = 1.8 * direction / np.linalg.norm(direction)
        camera = Camera.from_fov(0.85, look_along(position, -position), 128, 128, f"view{i}")
        shot = caster.cast([camera], {})[0]
        made.append(View(camera, shot.image, None, (shot.ids >= 0).astype(np.float32)))
    return Views(tuple(made))


def _write(root, shape, gaussians=True, mesh=True, name="toy"):
    folder = root / name / "5views"
    folder.mkdir(parents=True)
    if gaussians:
        write_gaussians(folder / "result.ply", surfels(shape, None, 3000))
    if mesh:
        write_mesh(folder / "result.glb", shape)
    return folder


def _build(root, **options):
    return BUILD(ResultTreeConfig(root=str(root), object="toy", **options))


def _off(made, shape):
    """The farthest that a corner of a face lies from where it should, metres."""
    corners = made.mesh.vertices[made.mesh.faces] - np.asarray(shape.vertices)[shape.faces]
    return float(np.linalg.norm(corners, axis=-1).max())


def test_a_result_in_the_calibrated_frame_stays_there(views, shape, tmp_path):
    _write(tmp_path, shape)
    made = _build(tmp_path).reconstruct(views)
    assert made.status == "ok"
    assert _off(made, shape) < 0.01


def test_a_canonical_result_is_brought_to_the_masks(views, shape, tmp_path):
    turn = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    scale, shift = 0.4, np.array([0.2, -0.1, 0.3])
    canonical = place_mesh(shape, np.linalg.inv(similarity(1.0, turn, np.zeros(3))))
    canonical = place_mesh(canonical, similarity(scale, np.eye(3), shift))
    _write(tmp_path, canonical)
    made = _build(tmp_path).reconstruct(views)
    assert made.status == "ok"
    assert _off(made, shape) < 0.02
    gap = np.linalg.norm(made.gaussians.centres - surfels(shape, None, 3000).centres.mean(axis=0), axis=1)
    assert gap.max() < 0.8


def test_the_pose_of_params_npz_is_used_and_its_scale_searched(views, shape, tmp_path):
    # What MV-SAM3D stores: rows times (s R) plus t, in PyTorch3D's camera (x left, y up), any depth scale.
    camera = views[0].camera
    depth_scale = 0.37
    p3d_from_camera = np.diag([-1.0, -1.0, 1.0])
    tilt = Rotation.from_euler("xyz", [0.5, -0.8, 1.9]).as_matrix()
    canonical = place_mesh(shape, similarity(0.8, tilt, np.array([0.1, 0.0, -0.2])))
    world_from_canonical = np.linalg.inv(similarity(0.8, tilt, np.array([0.1, 0.0, -0.2])))
    R = p3d_from_camera @ camera.camera_from_world[:3, :3] @ (world_from_canonical[:3, :3] * 0.8)
    t = p3d_from_camera @ (
        camera.camera_from_world[:3, :3] @ world_from_canonical[:3, 3] + camera.camera_from_world[:3, 3]
    )
    x, y, z, w = Rotation.from_matrix(R.T).as_quat()  # row vectors: the transpose
    folder = _write(tmp_path, canonical)
    np.savez(
        folder / "params.npz",
        scale=np.full((1, 3), depth_scale / 0.8),
        rotation=np.array([[w, x, y, z]]),
        translation=depth_scale * t[None],
    )
    made = _build(tmp_path).reconstruct(views)
    assert made.status == "ok"
    assert _off(made, shape) < 0.02


def test_a_mesh_without_gaussians_serves(views, shape, tmp_path):
    _write(tmp_path, shape, gaussians=False)
    made = _build(tmp_path, gaussians=1000).reconstruct(views)
    assert made.status == "fallback: the result has no .ply, flat Gaussians lie on the mesh"
    assert 800 < len(made.gaussians) < 1200


def test_a_poor_fit_is_reported(views, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    _write(tmp_path, TriangleMesh(ball.vertices + 3.0, ball.faces))
    assert "fit poorly" in _build(tmp_path).reconstruct(views).status


def test_what_is_missing_is_named(views, shape, tmp_path):
    with pytest.raises(ConfigurationError, match=r"reconstructor\.root"):
        BUILD(ResultTreeConfig(object="toy"))
    with pytest.raises(ConfigurationError, match=r"reconstructor\.object"):
        BUILD(ResultTreeConfig(root="here"))
    _write(tmp_path, shape, name="shoe")
    with pytest.raises(GeometryError, match=r"no folder.*toy.*Results there: shoe/5views"):
        _build(tmp_path).reconstruct(views)
    folder = _write(tmp_path, shape, gaussians=False, mesh=False)
    with pytest.raises(GeometryError, match=r"has no result\.glb"):
        _build(tmp_path).reconstruct(views)
    write_mesh(folder / "result.glb", shape)
    (folder / "result.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(GeometryError, match=r"result\.ply.*lack x"):
        _build(tmp_path).reconstruct(views)
    (folder / "result.ply").unlink()
    (folder / "params.npz").write_bytes(b"nothing")
    with pytest.raises(GeometryError, match=r"params\.npz"):
        _build(tmp_path).reconstruct(views)


def test_gaussians_move_with_scales_and_rotations(shape):
    renderer = Rasteriser()
    flat = surfels(shape, None, 150)
    move = similarity(
        1.7, Rotation.from_euler("xyz", [0.4, 1.0, -2.0]).as_matrix(), np.array([0.5, 2.0, -1.0])
    )
    eye = np.array([0.6, -1.6, 0.9])
    here = Camera.from_fov(0.9, look_along(eye, -eye), 48, 48)
    there = Camera(here.K, moved_poses(move, here.world_from_camera), 48, 48)
    before, _ = renderer.render(flat, here)
    after, _ = renderer.render(place_gaussians(flat, move), there)
    assert before.std() > 0.05
    np.testing.assert_allclose(after, before, atol=2e-3)
