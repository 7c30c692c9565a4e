import pytest

from gvla2.errors import GeometryError
from gvla2_plugins.sam3d.released_layout import find_summaries, objects, read_summary, result_folder


def test_a_summary_of_each_script_is_read(tmp_path):
    (tmp_path / "soft_visual_hull_summary.csv").write_text(
        "mean_strength,mean_support,mesh_status,n_input_views,object,status\n"
        "0.000312,0.941000,scene_vertices=4210,5,shoe,ok\n"
        ",,,,donut,missing_result_ply\n"
    )
    (tmp_path / "axis_refine_meshsync_summary.csv").write_text(
        'object,status,sx,views\nshoe,ok,1.01,"0,1,2,3,4"\n'
    )
    (tmp_path / "geometry_only_blend_summary.csv").write_text(
        "object,status,alpha,ply_status,mesh_status,source_a,source_b,output\n"
        "shoe,ok,0.5,ok,copied_a_scene_not_supported,a,b,c\n"
    )
    found = find_summaries(tmp_path)
    assert sorted(found) == ["axis", "fusion", "soft_hull"]
    shoe, donut = read_summary(found["soft_hull"])
    assert (shoe.object, shoe.status) == ("shoe", "ok")
    assert shoe.measures == {"mean_strength": 0.000312, "mean_support": 0.941, "n_input_views": 5}
    assert shoe.words == {"mesh_status": "scene_vertices=4210"}
    assert (donut.status, dict(donut.measures)) == ("missing_result_ply", {})
    assert read_summary(found["axis"])[0].words == {"views": "0,1,2,3,4"}
    assert read_summary(found["fusion"])[0].words["mesh_status"] == "copied_a_scene_not_supported"


def test_what_is_no_summary_is_named(tmp_path):
    with pytest.raises(GeometryError, match=r"nothing\.csv"):
        read_summary(tmp_path / "nothing.csv")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(GeometryError, match="no column 'object'"):
        read_summary(tmp_path / "other.csv")


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
