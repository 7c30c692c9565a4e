import pytest

from gvla2.errors import GeometryError
from gvla2_plugins.sam3d.result_tree import objects, result_folder


def test_trees(tmp_path):
    (tmp_path / "shoe" / "5views").mkdir(parents=True)
    (tmp_path / "donut" / "3views").mkdir(parents=True)
    assert objects(tmp_path) == ("shoe",)
    assert result_folder(tmp_path, "shoe").name == "5views"
    with pytest.raises(GeometryError, match=r"no object 'boot'.*shoe"):
        result_folder(tmp_path, "boot")
    with pytest.raises(GeometryError, match="Folders of 'donut': 3views"):
        result_folder(tmp_path, "donut")
    with pytest.raises(GeometryError, match="no result tree"):
        result_folder(tmp_path / "nowhere", "shoe")
