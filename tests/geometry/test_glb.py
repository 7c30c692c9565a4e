from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.glb import GlbFile, map_glb, to_y_up, to_z_up
from gvla2.geometry.gltf import pack
from gvla2.geometry.mesh_files import read_mesh
from gvla2.geometry.transform import rigid, transform_points


@given(arrays(float, (4, 3), elements=st.floats(-10, 10)))
def test_axes_there_and_back(points: np.ndarray) -> None:
    assert np.array_equal(to_z_up(to_y_up(points)), points)
    assert np.array_equal(to_y_up(to_z_up(points)), points)


def test_up_is_up_and_handedness_stays() -> None:
    assert to_y_up([0, 0, 1]).tolist() == [0, 1, 0]
    assert to_y_up([1, 2, 3]).tolist() == [1, 3, -2]
    assert np.linalg.det(to_y_up(np.eye(3))) == pytest.approx(1)


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    """Two textured, named parts under nodes with a rotation, a shift and a scale."""
    scene = trimesh.Scene()
    for i, name in enumerate(("body", "lid")):
        part = trimesh.creation.icosphere(subdivisions=2, radius=0.1 * (i + 1))
        image = Image.fromarray(np.full((4, 4, 3), 60 * (i + 1), dtype=np.uint8))
        uv = np.random.default_rng(i).random((len(part.vertices), 2))
        part.visual = trimesh.visual.TextureVisuals(
            uv=uv,
            material=trimesh.visual.material.PBRMaterial(
                baseColorTexture=image, roughnessFactor=0.3, name=name
            ),
        )
        _ = part.vertex_normals  # so that they are written
        pose = rigid(Rotation.from_euler("xyz", [0.3, -0.5, i]).as_matrix(), (0.1, 0.2, 0.3 * i))
        pose[:3, :3] *= 1 + i
        scene.add_geometry(part, node_name=f"node_{name}", geom_name=name, transform=pose)
    path = tmp_path / "scene.glb"
    path.write_bytes(scene.export(file_type="glb", include_normals=True))
    return path


def motion() -> np.ndarray:
    return rigid(Rotation.from_euler("zyx", [0.7, 0.2, -0.4]).as_matrix(), (1.0, -2.0, 0.5))


def test_positions_are_those_of_the_placed_meshes(scene_file: Path) -> None:
    assert np.allclose(
        np.sort(GlbFile.read(scene_file).positions(), axis=0),
        np.sort(read_mesh(scene_file).vertices, axis=0),
        atol=1e-6,
    )


def test_an_unchanged_file_is_written_unchanged(scene_file: Path) -> None:
    glb = GlbFile.read(scene_file)
    out = scene_file.with_name("out.glb")
    glb.write(out)
    again = GlbFile.read(out)
    assert (again.document, again.binary) == (glb.document, glb.binary)


def test_only_positions_and_normals_change(scene_file: Path) -> None:
    out = scene_file.with_name("out.glb")
    before = GlbFile.read(scene_file)
    map_glb(scene_file, out, lambda p: transform_points(motion(), p))
    after = GlbFile.read(out)
    assert np.allclose(after.positions(), transform_points(motion(), before.positions()), atol=1e-6)
    strip = lambda d: {**d, "accessors": [{**a, "min": 0, "max": 0} for a in d["accessors"]]}  # noqa: E731
    assert strip(before.document) == strip(after.document)  # materials, images, nodes, names
    touched = {
        before.document["accessors"][p["attributes"][name]]["bufferView"]
        for m in before.document["meshes"]
        for p in m["primitives"]
        for name in ("POSITION", "NORMAL")
    }
    for i, view in enumerate(before.document["bufferViews"]):
        part = slice(view["byteOffset"], view["byteOffset"] + view["byteLength"])
        assert (before.binary[part] == after.binary[part]) == (i not in touched)
    loaded = trimesh.load_scene(out, process=False)
    assert set(loaded.geometry) == {"body", "lid"}
    assert loaded.geometry["lid"].visual.material.roughnessFactor == pytest.approx(0.3)
    assert loaded.geometry["lid"].visual.material.baseColorTexture.getpixel((0, 0))[:3] == (120, 120, 120)


def test_normals_turn_with_a_rigid_motion(scene_file: Path) -> None:
    out = scene_file.with_name("out.glb")
    map_glb(scene_file, out, lambda p: transform_points(motion(), p))
    for path in (scene_file, out):
        scene = trimesh.load_scene(path, process=False)
        for node in scene.graph.nodes_geometry:
            name = scene.graph[node][1]
            part = scene.geometry[name]
            # On a sphere the normal is the direction from the centre.
            radial = part.vertices - part.vertices.mean(axis=0)
            radial /= np.linalg.norm(radial, axis=1, keepdims=True)
            glb = GlbFile.read(path)
            accessor = glb.document["meshes"][["body", "lid"].index(name)]["primitives"][0]["attributes"][
                "NORMAL"
            ]
            entry = glb.document["accessors"][accessor]
            view = glb.document["bufferViews"][entry["bufferView"]]
            stored = np.frombuffer(glb.binary, "<f4", 3 * entry["count"], view["byteOffset"]).reshape(-1, 3)
            assert np.einsum("ij,ij->i", stored, radial).min() > 0.99


def test_bounds_of_accessors_follow(scene_file: Path) -> None:
    glb = GlbFile.read(scene_file)
    moved = glb.with_positions(glb.positions() * 3)
    for mesh in moved.document["meshes"]:
        entry = moved.document["accessors"][mesh["primitives"][0]["attributes"]["POSITION"]]
        view = moved.document["bufferViews"][entry["bufferView"]]
        stored = np.frombuffer(moved.binary, "<f4", 3 * entry["count"], view["byteOffset"]).reshape(-1, 3)
        assert np.allclose(entry["min"], stored.min(axis=0))
        assert np.allclose(entry["max"], stored.max(axis=0))


def triangle(accessor: dict | None = None, **parts: object) -> bytes:
    """A small GLB by hand: one triangle, interleaved positions."""
    points = np.zeros((3, 5), dtype="<f4")
    points[:, :3] = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 60}],
        "bufferViews": [{"buffer": 0, "byteLength": 60, "byteStride": 20}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"} | (accessor or {})
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    return pack({**document, **parts}, points.tobytes())


def test_interleaved_vertices_are_found(tmp_path: Path) -> None:
    path = tmp_path / "t.glb"
    path.write_bytes(triangle())
    glb = GlbFile.read(path)
    assert glb.positions().tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 1]]
    moved = glb.with_positions(glb.positions() + np.array([0, 0, 1]))
    assert np.frombuffer(moved.binary, "<f4").reshape(3, 5)[:, 1].tolist() == [1, 1, 2]
    assert np.frombuffer(moved.binary, "<f4").reshape(3, 5)[:, 3:].tolist() == [[0, 0]] * 3


def test_a_mesh_placed_twice_moves_only_if_its_copies_agree(tmp_path: Path) -> None:
    nodes = [{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}]
    path = tmp_path / "t.glb"
    path.write_bytes(triangle(nodes=nodes, scenes=[{"nodes": [0, 1]}]))
    glb = GlbFile.read(path)
    assert glb.positions().shape == (6, 3)
    shifted = glb.positions() + np.array([0, 0.1, 0])
    assert np.allclose(glb.with_positions(shifted).positions(), shifted, atol=1e-6)
    with pytest.raises(GeometryError, match="several times"):
        glb.with_positions(glb.positions() * 2)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "malformed"),
        (b"glTF" + struct.pack("<II", 1, 12), "version 2"),
        (triangle()[:-20], "truncated"),
        (triangle({"count": 300}), "beyond its end"),
        (triangle({"componentType": 5123}), "quantised"),
        (triangle({"sparse": {}}), "sparsely"),
        (triangle(meshes=[]), "malformed"),
        (triangle(scenes=[{"nodes": []}]), "no vertices"),
        (triangle(nodes=[{"mesh": 0, "children": [0]}]), "loop"),
        (triangle(nodes=[{"mesh": 0, "scale": [float("nan")] * 3}]), "not finite"),
        (triangle(buffers=[{"byteLength": 60, "uri": "a.bin"}]), "another file"),
        (
            triangle(
                meshes=[
                    {
                        "primitives": [
                            {"attributes": {"POSITION": 0}, "extensions": {"KHR_draco_mesh_compression": {}}}
                        ]
                    }
                ]
            ),
            "Draco",
        ),
    ],
)
def test_files_that_cannot_be_moved_are_named_and_explained(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "odd.glb"
    path.write_bytes(content)
    with pytest.raises(GeometryError, match=words) as caught:
        GlbFile.read(path)
    assert "odd.glb" in str(caught.value)


def test_positions_of_another_shape_are_refused(scene_file: Path) -> None:
    glb = GlbFile.read(scene_file)
    with pytest.raises(GeometryError, match="needs finite positions"):
        glb.with_positions(np.zeros((3, 3)))
    assert json.dumps(glb.document)  # untouched


def test_a_mesh_squeezed_flat_cannot_be_moved(tmp_path: Path) -> None:
    path = tmp_path / "t.glb"
    path.write_bytes(triangle(nodes=[{"mesh": 0, "scale": [1, 1, 0]}]))
    glb = GlbFile.read(path)
    with pytest.raises(GeometryError, match="flat"):
        glb.with_positions(glb.positions())
