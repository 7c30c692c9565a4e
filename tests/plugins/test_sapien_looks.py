import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.geometry.transform import rigid
from gvla2.robot.collada import PaintedMesh, read_collada, thin
from gvla2.robot.looks import _read_mesh, body_surface, link_surfaces
from gvla2.robot.task import Body, Primitive
from gvla2.robot.urdf import find_file, find_mesh, read_urdf
from gvla2_plugins.sapien import SapienPandaConfig

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <library_effects><effect id="paint-effect"><profile_COMMON><technique sid="common"><phong>
    <diffuse><color sid="diffuse">0.2 0.4 0.6 1</color></diffuse>
  </phong></technique></profile_COMMON></effect></library_effects>
  <library_materials><material id="paint"><instance_effect url="#paint-effect"/></material></library_materials>
  <library_geometries><geometry id="g"><mesh>
    <source id="g-pos"><float_array id="g-arr" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array></source>
    <vertices id="g-v"><input semantic="POSITION" source="#g-pos"/></vertices>
    <triangles material="paint" count="2">
      <input semantic="NORMAL" source="#n" offset="0"/><input semantic="VERTEX" source="#g-v" offset="1"/>
      <p>9 0 9 1 9 2 9 0 9 2 9 3</p></triangles>
    <triangles material="unknown" count="1">
      <input semantic="VERTEX" source="#g-v" offset="0"/><p>0 1 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s">
    <node id="a"><matrix>1 0 0 5 0 1 0 0 0 0 2 0 0 0 0 1</matrix><instance_geometry url="#g"/></node>
    <node id="b"><instance_geometry url="#g"/></node>
  </visual_scene></library_visual_scenes>
</COLLADA>"""


def test_collada_triangles_colours_and_places(tmp_path):
    path = tmp_path / "mesh.dae"
    path.write_text(DAE)
    mesh = read_collada(path)
    assert mesh.faces.shape == (6, 3)
    corners = mesh.vertices[mesh.faces]
    np.testing.assert_array_equal(corners[0], [[5, 0, 0], [6, 0, 0], [5, 1, 0]])
    np.testing.assert_array_equal(corners[1], [[5, 0, 0], [5, 1, 0], [5, 0, 2]])
    np.testing.assert_array_equal(corners[3], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(mesh.rgb[:2], [[0.2, 0.4, 0.6]] * 2)
    np.testing.assert_allclose(mesh.rgb[2], [0.7] * 3)


def test_a_file_without_triangles_is_refused(tmp_path):
    path = tmp_path / "empty.dae"
    path.write_text(DAE.partition("<library_visual_scenes>")[0] + "</COLLADA>")
    with pytest.raises(RobotError, match=r"No triangles.*empty\.dae"):
        read_collada(path)


def test_polygons_are_fans_and_the_unit_counts(tmp_path):
    path = tmp_path / "mesh.dae"
    square = '<polylist count="1"><input semantic="VERTEX" source="#g-v" offset="0"/><vcount>4 3</vcount>'
    text = DAE.replace("<library_effects>", '<asset><unit meter="0.001"/></asset><library_effects>', 1)
    start, end = text.index("<triangles material"), text.index("</mesh>")
    path.write_text(f"{text[:start]}{square}<p>0 1 2 3 1 2 3</p></polylist>{text[end:]}")
    mesh = read_collada(path)
    np.testing.assert_array_equal(mesh.faces[:3], [[0, 1, 2], [0, 2, 3], [1, 2, 3]])
    np.testing.assert_allclose(mesh.vertices[1], [0.006, 0.0, 0.0])


def test_thinning_stays_within_a_cell():
    rng = np.random.default_rng(0)
    angles = rng.uniform(0, 2 * np.pi, (4000, 2))
    vertices = np.column_stack([np.cos(angles[:, 0]), np.sin(angles[:, 0]), np.cos(angles[:, 1])])
    mesh = PaintedMesh(vertices, np.arange(3999).reshape(-1, 3), np.zeros((1333, 3)))
    thinned = thin(mesh, 0.5)
    assert len(thinned.vertices) < 200
    assert len(thinned.faces) == len(thinned.rgb)
    nearest = np.linalg.norm(mesh.vertices[:, None] - thinned.vertices[None], axis=2).min(axis=1)
    assert nearest.max() <= 0.5 * np.sqrt(3)
    a, b, c = thinned.faces.T
    assert ((a != b) & (b != c) & (a != c)).all()


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
        "thing",
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


@pytest.mark.parametrize(("name", "why"), [("link.xyzq", "another kind"), ("link.stl", "no triangles")])
def test_a_mesh_that_is_none_is_named(tmp_path, name, why):
    file = tmp_path / name
    file.write_text("nothing")
    with pytest.raises(RobotError, match=rf"{name}.*{why}"):
        _read_mesh(file, (0.5, 0.5, 0.5), False)
