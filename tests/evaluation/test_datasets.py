import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gvla2.errors import ConfigurationError
from gvla2.evaluation.datasets import open_dataset, roots, true_mesh
from gvla2.evaluation.protocol import object_views
from gvla2.geometry.mesh_files import read_mesh, write_mesh


@pytest.fixture
def tree(tmp_path, block) -> Path:
    block(tmp_path / "objects" / "brick")
    block(tmp_path / "objects" / "slab", (0.2, 0.2, 0.02))
    (tmp_path / "objects" / "notes").mkdir()
    (tmp_path / "objects" / "README.md").write_text("not an object")
    return tmp_path / "objects"


def test_a_folder_of_meshes(tree):
    dataset = open_dataset("meshes", tree, size=32, samples=1)
    assert [item.name for item in dataset.items] == ["brick", "slab"]
    views = dataset.load(dataset.items[1])
    assert views.name == "slab"
    assert views.inputs[0].image.shape == (32, 32, 3)


def test_objects_are_chosen_in_the_order_asked(tree):
    dataset = open_dataset("meshes", tree, ["slab", "brick", "slab"])
    assert [item.name for item in dataset.items] == ["slab", "brick"]
    with pytest.raises(ConfigurationError, match="Did you mean 'brick'"):
        open_dataset("meshes", tree, ["brik"])


def test_what_is_missing_is_said(tmp_path, monkeypatch):
    with pytest.raises(ConfigurationError, match="No data set 'ycb'"):
        open_dataset("ycb")
    monkeypatch.setenv("GVLA2_DATA", str(tmp_path / "mine"))
    monkeypatch.chdir(tmp_path)
    assert roots("gso30")[0] == tmp_path / "mine" / "gso30"
    with pytest.raises(ConfigurationError) as shown:
        open_dataset("gso30", tmp_path / "nowhere")
    assert str(tmp_path / "nowhere") in str(shown.value)
    assert "CC BY 4.0" in str(shown.value)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigurationError, match="holds no object"):
        open_dataset("gso30", tmp_path / "empty")


def test_a_fingerprint_changes_with_the_files(tree):
    (brick, _) = open_dataset("meshes", tree).items
    before = brick.fingerprint()
    assert brick.fingerprint() == before
    os.utime(tree / "brick" / "texture.png", ns=(1, 1))
    assert brick.fingerprint() != before


def write_gso(folder: Path, source: Path) -> None:
    """A GSO-30 object as its renderer would have written it: OpenGL cameras, RGBA pictures."""
    from gvla2.evaluation.protocol import protocol_cameras, textured_view
    from gvla2.geometry.mesh_files import read_textured_mesh

    model = folder / "render_mvs_25" / "model"
    model.mkdir(parents=True)
    textured = read_textured_mesh(source).normalised()
    for n, camera in enumerate(protocol_cameras("x", 64)):
        view = textured_view(textured, camera, 2)
        alpha = np.rint(255 * view.mask).astype(np.uint8)
        Image.fromarray(np.dstack([view.image, alpha])).save(model / f"{n:03d}.png")
        np.save(model / f"{n:03d}.npy", (np.diag([1, -1, -1, 1]) @ view.camera.camera_from_world)[:3])


@pytest.mark.parametrize("upright", [True, False])
def test_a_gso_tree_with_a_true_shape_in_either_frame(tmp_path, block, upright):
    source = block(tmp_path / "source", (0.2, 0.1, 0.04))
    write_gso(tmp_path / "gso" / "object", source)
    mesh = read_mesh(source)
    shape = mesh.vertices if upright else mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]
    (tmp_path / "gso" / "object" / "meshes").mkdir()
    write_mesh(tmp_path / "gso" / "object" / "meshes" / "model.obj", mesh.with_vertices(shape))
    dataset = open_dataset("gso30", tmp_path / "gso", size=32)
    views = dataset.load(dataset.items[0])
    assert (len(views.inputs), len(views.targets)) == (5, 15)
    assert views.inputs[0].depth is None
    np.testing.assert_allclose(np.ptp(views.mesh.vertices, axis=0), [1, 0.5, 0.2], atol=1e-6)


def test_a_true_shape_that_the_masks_contradict_is_not_used(tmp_path, block, caplog):
    views = object_views(block(tmp_path / "flat", (0.2, 0.2, 0.02)), size=48, samples=2)
    other = block(tmp_path / "tall", (0.05, 0.05, 0.4))
    assert true_mesh(other, views.inputs) is None
    assert "does not agree" in caplog.text
    assert true_mesh(tmp_path / "absent.obj", views.inputs) is None
