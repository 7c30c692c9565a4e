import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.geometry.transform import rigid
from gvla2.robot.looks import _read_mesh, body_surface, link_surfaces
from gvla2.robot.task import Body, Primitive
from gvla2.robot.urdf import find_file, find_mesh, read_urdf
from gvla2_plugins.sapien import SapienPandaConfig


def test_the_pandas_links_look_right():
    surfaces = link_surfaces(read_urdf(find_file(SapienPandaConfig().urdf, "robot.urdf")))
    assert {f"panda_link{i}" for i in range(8)} <= surfaces.keys()
    assert {"panda_hand", "panda_leftfinger", "panda_rightfinger"} <= surfaces.keys()
    assert max(len(s.faces) for s in surfaces.values()) < 12000
    assert min(len(s.faces) for s in surfaces.values()) > 50
    left, right = surfaces["panda_leftfinger"].vertices, surfaces["panda_rightfinger"].vertices
    assert left[:, 1].mean() > 0.005  # mirrored by the URDF's origin
    assert right[:, 1].mean() < -0.005
    hand = surfaces["panda_hand"]
    assert np.ptp(hand.vertices[:, 1]) == pytest.approx(0.204, abs=0.01)
    light = (hand.rgb > 0.8).all(axis=1)
    assert light.any()  # off-white and dark
    assert (~light).any()


def test_a_missing_mesh_is_named(tmp_path):
    with pytest.raises(RobotError, match=r"visual/none\.dae"):
        find_mesh(tmp_path / "robot.urdf", "package://robots/visual/none.dae")


def test_a_bodys_solids_become_one_surface():
    body = Body(
        "object",
        (
            Primitive("box", (0.1, 0.2, 0.3), (1, 0, 0)),
            Primitive("cylinder", (0.04, 0.04, 0.5), (0, 1, 0), rigid(translation=(0.0, 0.0, 1.0))),
            Primitive("sphere", (0.2, 0.2, 0.2), (0, 0, 1), rigid(translation=(1.0, 0.0, 0.0))),
        ),
        np.eye(4),
    )
    surface = body_surface(body)
    for colour, low, high in (
        ((1, 0, 0), (-0.05, -0.1, -0.15), (0.05, 0.1, 0.15)),
        ((0, 1, 0), (-0.02, -0.02, 0.75), (0.02, 0.02, 1.25)),
        ((0, 0, 1), (0.9, -0.1, -0.1), (1.1, 0.1, 0.1)),
    ):
        faces = surface.faces[(surface.rgb == colour).all(axis=1)]
        corners = surface.vertices[faces].reshape(-1, 3)
        np.testing.assert_allclose(corners.min(axis=0), low, atol=2e-3)
        np.testing.assert_allclose(corners.max(axis=0), high, atol=2e-3)


@pytest.mark.parametrize("name", ["link.xyzq", "link.stl"])
def test_a_mesh_that_is_none_is_named(tmp_path, name):
    file = tmp_path / name
    file.write_text("nothing")
    with pytest.raises(RobotError, match=name):
        _read_mesh(file, (0.5, 0.5, 0.5), False)
