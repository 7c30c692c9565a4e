import pytest

from gvla2.errors import ConfigurationError
from gvla2.robot.scan import chosen, mesh_library, spoken
from tests.scanning import box, write


def test_files_and_folders_are_things(tmp_path):
    write(tmp_path, "mug", box(0.1, 0.1, 0.1), own_folder=False)
    write(tmp_path, "cracker_box", box(0.1, 0.1, 0.1))
    deep = write(tmp_path / "can", "google_16k", box(0.1, 0.1, 0.1))
    (tmp_path / "can" / "google_16k" / "collision.obj").write_text("")
    (tmp_path / "README.md").write_text("words")
    library = mesh_library(tmp_path)
    assert list(library) == ["can", "cracker_box", "mug"]
    assert library["can"] == deep
    assert list(chosen(library, ["cracker box", "mug"])) == ["cracker_box", "mug"]
    assert list(chosen(library, [])) == list(library)


@pytest.mark.parametrize(
    ("name", "words"), [("003_cracker_box", "cracker box"), ("Mug-2", "mug 2"), ("007", "007")]
)
def test_names_are_spoken_as_words(name, words):
    assert spoken(name) == words


def test_bad_folders(tmp_path):
    with pytest.raises(ConfigurationError, match="needs a folder"):
        mesh_library("")
    with pytest.raises(ConfigurationError, match="no folder"):
        mesh_library(tmp_path / "absent")
    with pytest.raises(ConfigurationError, match="holds no meshes"):
        mesh_library(tmp_path)
    write(tmp_path, "mug", box(0.1, 0.1, 0.1), own_folder=False)
    write(tmp_path, "mug", box(0.1, 0.1, 0.1))
    with pytest.raises(ConfigurationError, match=r"Two meshes .* are called 'mug'"):
        mesh_library(tmp_path)
