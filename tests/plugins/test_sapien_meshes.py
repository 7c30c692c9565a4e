"""Meshes as bodies of a simulated world: their pieces, their weight, their looks."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from gvla2.geometry.convex import piece_file
from gvla2.geometry.transform import rigid
from gvla2.plugins.registry import load_plugins
from gvla2.robot.depth_noise import apply_noise
from gvla2.robot.options import DepthNoise
from gvla2.robot.scan import read_scan, scanned_body
from gvla2.robot.task import Body, Layout, Primitive
from gvla2.robot.workcell import make_cell
from gvla2_plugins.sapien import SapienPandaConfig
from gvla2_plugins.sapien.world import SapienWorld
from tests.scanning import bowl, box, painted, write

TABLE = 0.752


def settled(layout):
    """Each body of a layout and where it is (4, 4) once the world has come to rest."""
    world = SapienWorld(SapienPandaConfig(), make_cell(SapienPandaConfig()), layout)
    return [(body, world.pose(body.name)) for body in layout.bodies]


@pytest.fixture(scope="module")
def bowl_file(tmp_path_factory):
    return write(tmp_path_factory.mktemp("scans"), "bowl", painted(bowl()))


def test_a_convex_object_is_one_piece_and_an_open_one_stays_open(tmp_path, bowl_file):
    ball = read_scan(
        write(tmp_path, "ball", painted(trimesh.creation.icosphere(subdivisions=4, radius=0.04)))
    )
    (whole,) = trimesh.load_mesh(piece_file(ball.textured.mesh)).split()
    assert whole.volume == pytest.approx(4 / 3 * np.pi * 0.04**3, rel=0.05)
    vessel = trimesh.load_mesh(piece_file(read_scan(bowl_file).textured.mesh)).split()
    assert len(vessel) > 4

    def holds(piece, points):
        away = np.einsum("ijk,jk->ij", points[:, None] - piece.triangles_center, piece.face_normals)
        return (away <= 0).all(axis=1)

    free = np.array([[0.0, 0.0, 0.01], [0.03, 0.03, 0.02], [-0.04, 0.0, 0.015]])
    assert not any(holds(piece, free).any() for piece in vessel)
    assert any(holds(piece, np.array([[0.0, 0.0, -0.0225]])).any() for piece in vessel)


def test_things_fall_into_a_bowl_and_stay(bowl_file, tmp_path):
    spot = rigid(translation=(0.2, 0.1, TABLE + 0.0255))
    cube = Body(
        "cube",
        (Primitive("box", (0.02, 0.02, 0.02), (1, 0, 0)),),
        rigid(translation=(0.21, 0.1, TABLE + 0.06)),
    )
    vessel = scanned_body(bowl_file, "bowl", spot, mass=0.2)
    world = SapienWorld(SapienPandaConfig(), make_cell(SapienPandaConfig()), Layout((vessel, cube)))
    now = world.pose("cube")[:3, 3]
    assert np.linalg.norm(now[:2] - (0.2, 0.1)) < 0.06
    assert TABLE + 0.01 < now[2] < TABLE + 0.03
    assert world.touching("cube") == {"bowl"}
    np.testing.assert_allclose(world.pose("bowl")[:3, 3], spot[:3, 3], atol=0.003)


def test_the_mass_is_the_one_given(bowl_file, tmp_path):
    carton = write(tmp_path, "carton", painted(box(0.05, 0.06, 0.07)))
    for path, mass in ((bowl_file, 0.25), (carton, 0.4)):
        body = scanned_body(path, "it", rigid(translation=(0.2, 0.0, TABLE + 0.05)), mass=mass)
        world = SapienWorld(SapienPandaConfig(), make_cell(SapienPandaConfig()), Layout((body,)))
        (mover,) = world._movers
        assert mover.mass == pytest.approx(mass, rel=0.01)


def test_people_are_shown_finer_pictures_of_the_same_moment(bowl_file):
    registry = load_plugins()
    options = {"name": "tabletop_objects", "objects": {"root": str(bowl_file.parent.parent)}}
    parts = registry.build_all({"robot": {"name": "sapien_panda"}, "task": options}, ("robot", "task"))
    robot = parts["robot"]
    robot.reset(parts["task"], 0)
    seen = apply_noise(robot.observe(), DepthNoise(offset_m=0.002), np.random.default_rng(0))
    fine = seen.pictured()
    assert [v.image.shape for v in seen.views] == [(256, 256, 3)] * 4
    assert [v.image.shape for v in fine] == [(640, 640, 3)] * 4
    for view, shown in zip(seen.views, fine, strict=True):
        assert shown.name == view.name
        np.testing.assert_array_equal(shown.camera.world_from_camera, view.camera.world_from_camera)
        reduced = np.asarray(Image.fromarray(shown.image).resize((256, 256), Image.Resampling.BOX)).astype(
            int
        )
        assert np.abs(reduced - view.image).mean() < 6
    robot.close()
