from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from gvla2.errors import GeometryError, OutputError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh, write_mesh


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
    assert np.allclose(back.vertices, mesh.vertices, atol=1e-6)
    assert np.array_equal(back.faces, mesh.faces)
    if coloured:
        assert np.allclose(back.colours, mesh.colours, atol=1e-3)


def test_glb_is_y_up_on_disk(tmp_path: Path) -> None:
    mesh = wedge(False)
    write_mesh(tmp_path / "m.glb", mesh)
    raw = trimesh.load_scene(tmp_path / "m.glb", process=False).to_mesh().vertices
    x, y, z = mesh.vertices.T
    assert np.allclose(raw, np.stack([x, z, -y], axis=1), atol=1e-6)


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
    visual = trimesh.visual.TextureVisuals(uv=square[:, :2] * 0.98 + 0.01, image=image)
    faces = [[0, 1, 2], [0, 2, 3]]
    trimesh.Trimesh(square, faces, visual=visual, process=False).export(tmp_path / "t.glb")
    colours = read_mesh(tmp_path / "t.glb").colours
    assert colours is not None
    assert np.allclose(colours[[0, 3]], [1, 0, 0])
    assert np.allclose(colours[[1, 2]], [0, 0, 1])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("m.stl", b"", "'.stl'"),
        ("m.obj", None, "no such file"),
        ("m.glb", b"junk", "m.glb"),
        ("m.ply", b"ply\nformat", "m.ply"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\n", "no triangles"),
        ("m.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("m.obj", b"", "m.obj"),
    ],
)
def test_broken_files_are_named_and_explained(
    tmp_path: Path, name: str, content: bytes | None, words: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(GeometryError, match=words):
        read_mesh(tmp_path / name)


def test_writing_into_nowhere_is_an_output_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_mesh(tmp_path / "nowhere" / "m.obj", wedge(False))
    with pytest.raises(GeometryError, match=r"'\.stl'"):
        write_mesh(tmp_path / "m.stl", wedge(False))
