from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from gvla2.errors import GeometryError, OutputError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import (
    read_mesh,
    read_textured_mesh,
    to_y_up,
    to_z_up,
    write_mesh,
)


@given(arrays(float, (4, 3), elements=st.floats(-10, 10)))
def test_axes_there_and_back(points: np.ndarray) -> None:
    assert np.array_equal(to_z_up(to_y_up(points)), points)
    assert to_y_up([1, 2, 3]).tolist() == [1, 3, -2]


def wedge(coloured: bool) -> TriangleMesh:
    rng = np.random.default_rng(3)
    vertices = rng.normal(size=(6, 3)).astype(np.float32)
    faces = np.array([[0, 1, 2], [3, 4, 5], [0, 2, 4], [1, 1, 5]])  # the last has no area
    return TriangleMesh(vertices, faces, rng.integers(0, 256, (6, 3)) / 255 if coloured else None)


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".ply"])
@pytest.mark.parametrize("coloured", [True, False])
def test_what_is_written_is_read(tmp_path: Path, suffix: str, coloured: bool) -> None:
    mesh = wedge(coloured)
    write_mesh(tmp_path / f"m{suffix}", mesh)
    back = read_mesh(tmp_path / f"m{suffix}")
    assert np.allclose(back.vertices[back.faces], mesh.vertices[mesh.faces], atol=1e-6)
    if coloured:
        assert np.allclose(back.colours[back.faces], mesh.colours[mesh.faces], atol=1e-3)
    else:
        assert back.colours is None


def test_several_meshes_are_placed_by_the_scene(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    box = trimesh.creation.box((1, 1, 1))
    for i in range(2):
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([0, 5.0 * i, 0]))
    scene.export(tmp_path / "two.glb")
    mesh = read_mesh(tmp_path / "two.glb")
    assert len(mesh.faces) == 24
    assert np.allclose(mesh.bounds, [[-0.5, -0.5, -0.5], [0.5, 0.5, 5.5]])  # the file's y is our z


def test_texture_gives_vertex_colours(tmp_path: Path) -> None:
    image = Image.new("RGB", (2, 1), (255, 0, 0))
    image.putpixel((1, 0), (0, 0, 255))
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    visual = trimesh.visual.TextureVisuals(uv=square[:, :2], material=material)
    trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False).export(tmp_path / "t.glb")
    mesh = read_mesh(tmp_path / "t.glb")
    left = mesh.vertices[:, 0] < 0.5
    assert np.allclose(mesh.colours[left], [1, 0, 0])
    assert np.allclose(mesh.colours[~left], [0, 0, 1])


OBJ = "mtllib kd.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
MTL = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n"


def test_materials_that_have_a_colour_alone(tmp_path: Path) -> None:
    (tmp_path / "kd.mtl").write_text(MTL)
    (tmp_path / "m.obj").write_text(OBJ + "usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n")
    textured = read_textured_mesh(tmp_path / "m.obj")
    assert sorted(textured.rgb[:, 0].tolist()) == [[0, 0, 1], [1, 0, 0]]
    assert not textured.images
    box = trimesh.creation.box((0.06, 0.08, 0.1))
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[1.0, 0.0, 0.0, 1.0])
    )
    box.export(tmp_path / "m.glb")
    assert np.allclose(read_mesh(tmp_path / "m.glb").colours, [1, 0, 0])


def test_polygons_with_negative_indices_and_stray_vertices(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 9 9 9\n" + OBJ.partition("\n")[2] + "f -4 -3 -2 -1\n")
    mesh = read_mesh(tmp_path / "m.obj")
    assert len(mesh.faces) == 2
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 1, 0]]


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
QUAD = "f 1/1 2/2 3/3 4/4\n"
LIBRARIES = {
    "tex.mtl": "newmtl m\nKd 1 1 1\nmap_Kd my red.png\n",
    "windows.mtl": "newmtl m\r\nKd 1 1 1\r\nmap_Kd C:\\\\scans\\\\MY%20RED.PNG\r\n",
    "options.mtl": "\ufeffnewmtl m\nmap_Kd -s 1 1 1 -blendu on -o 0 0 0 my red.png\n",
    "gone.mtl": "newmtl m\nKd 1 0 0\nmap_Kd gone.png\n",
    "my colours.mtl": "newmtl my red\nKd 1 0 0\nnewmtl m\nKd 1 0 0\n",
}
RED_SQUARES = {
    "texture": f"mtllib tex.mtl\n{SQUARE}usemtl m\n{QUAD}",
    "byte order mark": f"\ufeffmtllib tex.mtl\n{SQUARE}usemtl m\n{QUAD}",
    "CR LF": f"mtllib tex.mtl\n{SQUARE}usemtl m\n{QUAD}".replace("\n", "\r\n"),
    "CR": f"mtllib tex.mtl\n{SQUARE}usemtl m\n{QUAD}".replace("\n", "\r"),
    "Windows paths": f"mtllib windows.mtl\n{SQUARE}usemtl m\n{QUAD}",
    "options of pictures": f"mtllib options.mtl\n{SQUARE}usemtl m\n{QUAD}",
    "a missing picture": f"mtllib gone.mtl\n{SQUARE}usemtl m\n{QUAD}",
    "spaces in names": f"mtllib my colours.mtl\n{SQUARE}usemtl my red\n{QUAD}",
    "two libraries": f"mtllib my colours.mtl\nmtllib tex.mtl\n{SQUARE}usemtl my red\nf 1/1 2/2 3/3\nusemtl m\n"
    "f 1/1 3/3 4/4\n",
    "tabs": f"mtllib\ttex.mtl\n{SQUARE}usemtl\tm\n{QUAD}".replace(" ", "  "),
    "comments": f"# M\u00fcller\nmtllib tex.mtl\n{SQUARE}usemtl m\n{QUAD[:-1]} # a quad\n",
    "continued lines": f"mtllib tex.mtl\n{SQUARE}usemtl m\n" + QUAD.replace(" 3/3", " \\\n3/3"),
    "colours of vertices": SQUARE.replace("0\nv", "0 255 0 0\nv").replace("0 1 0\nvt", "0 1 0 255 0 0\nvt")
    + "f 1 2 3 4\n",
}


@pytest.mark.parametrize("dialect", RED_SQUARES)
def test_a_red_square_in_the_dialects_of_obj(tmp_path: Path, dialect: str) -> None:
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "my red.png")
    for name, text in LIBRARIES.items():
        (tmp_path / name).write_bytes(text.encode())
    (tmp_path / "m.obj").write_bytes(RED_SQUARES[dialect].encode())
    textured = read_textured_mesh(tmp_path / "m.obj")
    assert textured.mesh.bounds.tolist() == [[0, 0, 0], [1, 1, 0]]
    assert np.allclose(textured.face_colours, [1, 0, 0])
    assert len(textured.mesh.faces) == 2


@pytest.mark.parametrize(
    "names", ["red green blue", "diffuse_red diffuse_green diffuse_blue", "r g b", "u v w"]
)
def test_colours_of_ply_by_their_several_names(tmp_path: Path, names: str) -> None:
    header = "".join(f"property uchar {name}\r\n" for name in names.split())
    rows = "".join(f"{x} {y} 0 255 0 0\r\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    xyz = "".join(f"property float {axis}\r\n" for axis in "xyz")
    (tmp_path / "m.ply").write_bytes(
        f"ply\r\nformat ascii 1.0\r\nelement vertex 4\r\n{xyz}{header}element face 1\r\n"
        f"property list uchar int vertex_indices\r\nend_header\r\n{rows}4 0 1 2 3\r\n".encode()
    )
    textured = read_textured_mesh(tmp_path / "m.ply")
    if names == "u v w":  # texture coordinates without a picture are no colour
        assert not textured.has_colours
    else:
        assert np.allclose(textured.face_colours, [1, 0, 0])


@pytest.mark.parametrize(
    ("kind", "vertex", "face"),
    [
        ("COFF", " 255 0 0 255", ""),
        ("COFF ", " 1.0 0.0 0.0", ""),
        ("CNOFF", " 0 0 1 255 0 0", ""),
        ("OFF # by hand", "", " 255 0 0"),
        ("OFF", "", " 1.0 0.0 0.0 1.0 # red"),
    ],
)
def test_colours_of_off(tmp_path: Path, kind: str, vertex: str, face: str) -> None:
    square = "".join(f"{at}{vertex}\n" for at in ("0 0 0", "1 0 0", "1 1 0", "0 1 0"))
    (tmp_path / "m.off").write_text(f"{kind}\n4 1 0\n\n{square}4 0 1 2 3{face}\n")
    mesh = read_mesh(tmp_path / "m.off")
    assert len(mesh.faces) == 2
    np.testing.assert_allclose(mesh.colours, np.tile([1.0, 0, 0], (4, 1)))


def test_a_binary_stl_file_with_something_behind_its_triangles(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 2, 3)).export(file_type="stl")
    (tmp_path / "m.stl").write_bytes(b"solid by hand" + box[13:] + b"\n")
    np.testing.assert_allclose(read_mesh(tmp_path / "m.stl").bounds, [[-0.5, -1, -1.5], [0.5, 1, 1.5]])


BENT = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (3, 3), (3, 4), (0, 4)]
"""A C-shaped polygon of area 9."""


@pytest.mark.parametrize("start", range(len(BENT)))
@pytest.mark.parametrize("kind", ["obj", "negative obj", "off"])
def test_a_polygon_that_is_not_convex_is_filled_within(tmp_path: Path, kind: str, start: int) -> None:
    turned = BENT[start:] + BENT[:start]
    rows, count = [f"{x} {x - y} {y}" for x, y in turned], len(BENT)
    numbers = {"obj": range(1, count + 1), "negative obj": range(-count, 0), "off": range(count)}[kind]
    face = " ".join(f"{n}//" if "obj" in kind else f"{n}" for n in numbers)
    path = tmp_path / f"m.{kind[-3:]}"
    if kind == "off":
        path.write_text("\n".join(["OFF", f"{count} 1 0", *rows, f"{count} {face}"]))
    else:
        path.write_text("\n".join([*(f"v  {row}" for row in rows), f"f {face}", ""]))
    mesh = read_mesh(path)
    assert len(mesh.faces) == count - 2
    assert mesh.areas.sum() == pytest.approx(9 * np.sqrt(3))
    assert (mesh.normals @ mesh.normals[0] > 0.99).all()


def test_a_missing_library_leaves_a_mesh_without_colours(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(f"mtllib gone.mtl\n{SQUARE}usemtl m\n{QUAD}")
    assert not read_textured_mesh(tmp_path / "m.obj").has_colours


def added(tree: dict[str, Any], rows: np.ndarray) -> int:
    """Add an array (N, K) to a glTF file; the number of its accessor."""
    uri = f"data:application/octet-stream;base64,{base64.b64encode(rows.tobytes()).decode()}"
    tree["buffers"].append({"uri": uri, "byteLength": rows.nbytes})
    tree["bufferViews"].append({"buffer": len(tree["buffers"]) - 1, "byteLength": rows.nbytes})
    kind, integers = {"f": 5126, "u": 5123}[rows.dtype.kind], rows.dtype.kind == "u"
    accessor = {"bufferView": len(tree["bufferViews"]) - 1, "componentType": kind, "count": len(rows)}
    tree["accessors"].append({**accessor, "type": f"VEC{rows.shape[1]}", "normalized": integers})
    return len(tree["accessors"]) - 1


def of_integers(tree: dict[str, Any], base: dict[str, Any]) -> None:
    rows = np.full((4, 2), round(0.8 * 65535), dtype=np.uint16)
    tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = added(tree, rows)


def of_integer_colours(tree: dict[str, Any], base: dict[str, Any]) -> None:
    base.clear()
    rows = np.tile(np.array([65535, 0, 0, 65535], dtype=np.uint16), (4, 1))
    tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = added(tree, rows)


@pytest.mark.parametrize(
    "change",
    [
        of_integers,
        of_integer_colours,
        lambda tree, base: base["baseColorTexture"].update(texCoord=1),
        lambda tree, base: base["baseColorTexture"].update(
            extensions={"KHR_texture_transform": {"offset": [0.5, 0.0]}}
        ),
        lambda tree, base: base["baseColorTexture"].update(
            extensions={"KHR_texture_transform": {"rotation": np.pi, "offset": [1.0, 1.0]}}
        ),
        lambda tree, base: tree["materials"][0].update(
            pbrMetallicRoughness={},
            extensions={"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1]}},
        ),
    ],
    ids=["integers", "colours of 16 bits", "second set", "moved", "turned", "specular-glossiness"],
)
def test_where_gltf_files_have_their_colour(tmp_path: Path, change: Callable[..., None]) -> None:
    """The picture's left half is blue, its right half red; the first set of coordinates lies on the left."""
    picture = Image.new("RGB", (4, 4), (0, 0, 255))
    picture.paste((255, 0, 0), (2, 0, 4, 4))
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture)
    visual = trimesh.visual.TextureVisuals(uv=np.full((4, 2), 0.2), material=material)
    made = trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)

    files = made.scene().export(file_type="gltf")
    tree = json.loads(files.pop("model.gltf"))
    attributes = tree["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_1"] = added(tree, np.full((4, 2), 0.8, dtype=np.float32))
    change(tree, tree["materials"][0]["pbrMetallicRoughness"])
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "m.gltf").write_text(json.dumps(tree))
    textured = read_textured_mesh(tmp_path / "m.gltf")
    assert np.allclose(textured.face_colours, [1, 0, 0], atol=0.01)


CORNERS = [(x, y, z) for z in (0, 0.3) for x, y in ((0, 0), (0.1, 0), (0.1, 0.2), (0, 0.2))]
SIDES = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
FANS = " ".join(f"{a} {b} {c} {a} {c} {d}" for a, b, c, d in SIDES)
INPUT = '<input semantic="VERTEX" source="#v" offset="0"/>'
TRIANGLES = f'<triangles count="12" material="paint">{INPUT}<p>{FANS}</p></triangles>'
EACH = "".join("<p>" + " ".join(map(str, side)) + "</p>" for side in SIDES)
POLYGONS = f'<polygons count="6">{INPUT}{EACH}</polygons>'
STRIP = f'<tristrips count="1">{INPUT}<p>0 1 3 2</p></tristrips>'
BOUND = (
    '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="paint" '
    'target="#red"/></technique_common></bind_material></instance_geometry>'
)
RED = (
    '<library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert><diffuse><color>1 0 0 1</color>'
    "</diffuse></lambert></technique></profile_COMMON></effect></library_effects><library_materials><material "
    'id="red"><instance_effect url="#e"/></material></library_materials>'
)


def collada(
    path: Path, node: str = "", up: str = "Z_UP", unit: str = "1", shape: str = TRIANGLES, **more: str
) -> Path:
    """A box of 0.1 x 0.2 x 0.3 units; ``node`` are the transforms of its node."""
    numbers = " ".join(str(value) for corner in CORNERS for value in corner)
    namespace = more.get("namespace", ' xmlns="http://www.collada.org/2005/11/COLLADASchema"')
    instance = more.get("instance", BOUND)
    axes = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    path.write_text(
        f'<?xml version="1.0"?><COLLADA{namespace} version="1.4.1"><asset><unit name="u" meter="{unit}"/>'
        f'<up_axis>{up}</up_axis></asset>{RED}<library_geometries><geometry id="g"><mesh><source id="p"><float_array '
        f'id="a" count="24">{numbers}</float_array><technique_common><accessor source="#a" count="8" stride="3">{axes}'
        f'</accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f"{shape}</mesh></geometry></library_geometries>{more.get('library', '')}<library_visual_scenes>"
        f'<visual_scene id="S"><node>{node}{instance}</node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#S"/></scene></COLLADA>'
    )
    return path


def scaled(factor: float, x: float) -> str:
    return f"<matrix>{factor} 0 0 {x} 0 {factor} 0 0 0 0 {factor} 0 0 0 0 1</matrix>"


@pytest.mark.parametrize(
    ("options", "low", "high", "faces"),
    [
        ({}, [0, 0, 0], [0.1, 0.2, 0.3], 12),
        ({"node": "<translate>1 0 0</translate><scale>2 2 2</scale>"}, [1, 0, 0], [1.2, 0.4, 0.6], 12),
        ({"node": "<rotate>1 0 0 90</rotate>"}, [0, -0.3, 0], [0.1, 0, 0.2], 12),
        ({"node": scaled(2, 0) + scaled(1, 1)}, [2, 0, 0], [2.2, 0.4, 0.6], 12),
        (
            {"node": scaled(0.1, 0), "instance": f"<node>{scaled(1, 5)}{BOUND}</node>"},
            [0.5, 0, 0],
            [0.51, 0.02, 0.03],
            12,
        ),
        ({"up": "Y_UP"}, [0, -0.3, 0], [0.1, 0, 0.2], 12),
        ({"unit": "0.001"}, [0, 0, 0], [1e-4, 2e-4, 3e-4], 12),
        ({"shape": POLYGONS}, [0, 0, 0], [0.1, 0.2, 0.3], 12),
        ({"shape": STRIP + POLYGONS}, [0, 0, 0], [0.1, 0.2, 0.3], 14),
        (
            {
                "instance": '<instance_node url="#n"/>',
                "library": f'<library_nodes><node id="n">{BOUND}</node></library_nodes>',
            },
            [0, 0, 0],
            [0.1, 0.2, 0.3],
            12,
        ),
        ({"namespace": ""}, [0, 0, 0], [0.1, 0.2, 0.3], 12),
    ],
)
def test_collada_nodes_units_and_axes(
    tmp_path: Path, options: dict[str, str], low: list[float], high: list[float], faces: int
) -> None:
    mesh = read_mesh(collada(tmp_path / "box.dae", **options))
    np.testing.assert_allclose(mesh.bounds, [low, high], atol=1e-6)
    assert len(mesh.faces) == faces
    if "shape" not in options:
        np.testing.assert_allclose(mesh.colours, np.tile([1.0, 0, 0], (8, 1)))


def test_the_colour_of_unlit_collada_is_what_it_emits(tmp_path: Path) -> None:
    path = collada(tmp_path / "box.dae")
    path.write_text(path.read_text().replace("diffuse", "emission"))
    np.testing.assert_allclose(read_mesh(path).colours, np.tile([1.0, 0, 0], (8, 1)))


LOST_PICTURE = (
    '<effect id="e"><profile_COMMON><newparam sid="s"><sampler2D><source>gone-surface</source></sampler2D></newparam>'
    '<technique sid="c"><lambert><diffuse><texture texture="s" texcoord="UV"/></diffuse></lambert></technique>'
)


@pytest.mark.parametrize(
    ("found", "instead"),
    [
        (
            '<effect id="e"><profile_COMMON><technique sid="c"><lambert><diffuse><color>1 0 0 1</color></diffuse>',
            "",
        ),
        ('<instance_effect url="#e"/>', '<instance_effect url="#gone"/>'),
        ('target="#red"', 'target="#gone"'),
        ("<?xml", "\ufeff<?xml"),
    ],
    ids=["a picture", "an effect", "a material", "nothing but a mark"],
)
def test_collada_whose_materials_refer_to_what_it_lacks(tmp_path: Path, found: str, instead: str) -> None:
    path = collada(tmp_path / "box.dae")
    text = path.read_text()
    assert found in text
    if not instead:
        found, instead = f"{found}</lambert></technique>", LOST_PICTURE
    path.write_text(text.replace(found, instead))
    mesh = read_mesh(path)
    assert len(mesh.faces) == 12
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [0.1, 0.2, 0.3]], atol=1e-6)


def test_collada_that_places_what_it_lacks_is_refused(tmp_path: Path) -> None:
    path = collada(tmp_path / "box.dae")
    path.write_text(path.read_text().replace('url="#g"', 'url="#gone"'))
    with pytest.raises(GeometryError, match=r"box\.dae: it places gone, which it does not hold"):
        read_mesh(path)


def test_a_robots_tools_ignore_the_up_axis_of_collada(tmp_path: Path) -> None:
    mesh = read_mesh(collada(tmp_path / "box.dae", up="Y_UP"), up="z")
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [0.1, 0.2, 0.3]], atol=1e-6)


@pytest.mark.parametrize(("suffix", "limit"), [(".obj", 9), (".obj", 5), (".glb", 9)])
def test_a_picture_that_would_fill_the_memory_is_refused(tmp_path: Path, monkeypatch, suffix, limit) -> None:
    box = trimesh.creation.box((1, 1, 1))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), image=Image.new("RGB", (4, 4), "red"))
    box.export(tmp_path / f"m{suffix}")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", limit)  # Pillow itself refuses twice that
    with pytest.raises(GeometryError, match=rf"m\{suffix}: its picture .*too large"):
        read_mesh(tmp_path / f"m{suffix}")


def with_change(change: Callable[[Any], object]) -> Callable[[Path], object]:
    """Writes the GLB file of a box whose tree was changed."""
    box = trimesh.creation.box((1, 1, 1)).scene()
    return lambda path: path.write_bytes(box.export(file_type="glb", tree_postprocessor=change))


def using(extension: str) -> Callable[[Path], object]:
    return with_change(lambda tree: tree.update(extensionsUsed=[extension]))


def jagged(count: int) -> bytes:
    turns = np.exp(2j * np.pi * np.arange(count) / count) * (1 + np.arange(count) % 2)
    rows = [f"{turn.real} {turn.imag} 0" for turn in turns]
    return "\n".join([f"OFF {count} 1 0", *rows, f"{count} {' '.join(map(str, range(count)))}"]).encode()


def test_a_face_of_many_corners_in_and_out_has_its_own_area(tmp_path: Path) -> None:
    (tmp_path / "star.off").write_bytes(jagged(502))
    mesh = read_mesh(tmp_path / "star.off")
    area = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area
    assert area == pytest.approx(502 * np.sin(2 * np.pi / 502))


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a2146\nsize 12345\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("m.blend", b"", "'.blend'"),
        ("m.obj", None, "no such file"),
        ("m.glb", b"junk", "m.glb"),
        ("m.ply", b"ply\nformat", "m.ply"),
        ("m.dae", b"<COLLADA/>", "m.dae"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\n", "no triangles"),
        ("m.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("m.obj", b"", "m.obj"),
        ("m.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99\n", "m.off"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "'f 0 1 2' names vertex 0"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "m.obj"),
        ("m.glb", using("EXT_meshopt_compression"), "EXT_meshopt_compression"),
        ("m.glb", using("EXT_mesh_gpu_instancing"), "EXT_mesh_gpu_instancing"),
        ("m.glb", with_change(lambda t: t["meshes"][0]["primitives"][0].update(mode=6)), "triangle fans"),
        ("m.glb", with_change(lambda t: t["meshes"][0].update(weights=[0, 0.5])), "morph targets"),
        ("m.glb", with_change(lambda t: t["nodes"][-1].update(skin=0)), "skins"),
        ("m.stl", trimesh.creation.box((1, 1, 1)).export(file_type="stl")[:-20], "do not hold 12 triangles"),
        ("m.stl", POINTER * 2, "Git LFS pointer.*git lfs pull"),
        ("m.obj", POINTER, "Git LFS pointer.*git lfs pull"),
    ],
)
def test_broken_files_are_named_and_explained(tmp_path: Path, name: str, content: object, words: str) -> None:
    if callable(content):
        content(tmp_path / name)
    elif content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(GeometryError, match=words):
        read_mesh(tmp_path / name)


def test_writing_into_nowhere_is_an_output_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_mesh(tmp_path / "nowhere" / "m.obj", wedge(False))
    with pytest.raises(GeometryError, match=r"'\.stl'"):
        write_mesh(tmp_path / "m.stl", wedge(False))
