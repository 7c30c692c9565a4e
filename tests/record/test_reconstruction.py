"""A reconstruction's numbers, pictures and page, made of a real one: a cube carved from three views of a table."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.geometry.camera import Camera
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.branch import BranchComponents, refine_geometry
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import Reconstruction, StageReport
from gvla2.record import reconstruction_measures as pictured
from gvla2.record.drawing import Rect
from gvla2.record.reconstruction import (
    ReconstructionRecord,
    render_reconstruction,
)
from gvla2.record.reconstruction_measures import ViewPictures, measure, view_pictures
from gvla2.testing.inputs import RED
from gvla2.testing.inputs import views as table_views
from tests.record.test_page import Reader


@pytest.fixture(scope="module")
def renderer(registry):
    return registry.build({"renderer": {"name": "numba"}}, "renderer")


@pytest.fixture(scope="module")
def views() -> Views:
    return table_views(160, masked=RED)


def enlarged(made: Reconstruction, factor: float) -> Reconstruction:
    """The object grown about its middle."""
    middle = made.mesh.bounds.mean(axis=0)
    return replace(
        made,
        gaussians=made.gaussians.with_centres(middle + factor * (made.gaussians.centres - middle)),
        mesh=made.mesh.with_vertices(middle + factor * (made.mesh.vertices - middle)),
    )


@pytest.fixture(scope="module")
def record(registry, renderer, views) -> ReconstructionRecord:
    """The cube, first made a tenth too large."""
    g0 = enlarged(carve(views, 24).to_reconstruction(1500), 1.1)
    choices = {"prior": "none", "axis": "contours", "fusion": "residual"}
    parts = registry.build_all({kind: {"name": name} for kind, name in choices.items()}, choices)
    result = refine_geometry(g0, views, BranchComponents(*parts.values(), renderer))
    return ReconstructionRecord(
        "red cube",
        "a/folder",
        views,
        {"reconstructor": "hull", **choices, "renderer": "numba"},
        {"mode": "default"},
        result,
        measure(result, views, renderer),
        timings={"read": 0.1, "reconstruct": 0.2, "refine": 0.3, "measure": 0.1, "draw": 0.4},
    )


@pytest.fixture(scope="module")
def pictures(record) -> tuple[ViewPictures, ...]:
    return view_pictures(record.views, record.measures)


def test_the_refined_cube_fits_its_views_better(record):
    before, after = record.measures.groups["inputs"]
    assert after["symmetric_iou"] > before["symmetric_iou"]
    assert after["psnr"] > before["psnr"]
    assert record.changed
    # A tenth of the half side by the branch, and at most two pixels of this small picture inwards after that.
    assert 0.0005 < record.displacement < 0.02


def test_against_the_truth_the_smaller_cube_is_nearer(record, views, renderer):
    groups = measure(record.result, views, renderer, truth=carve(views, 24).mesh).groups
    before, after = groups["truth"]
    assert after["cd_surface"] < before["cd_surface"]


def test_held_out_views_are_named(record, views, renderer):
    held = measure(record.result, views, renderer, held_out=views)
    assert held.held_out == tuple(view.name for view in views)
    assert {"psnr", "ssim"} <= set(held.groups["held_out"][1])


def test_the_residual_shows_each_kind_of_pixel():
    camera = Camera.from_fov(0.8, np.eye(4), 60, 60, "one")
    mask, silhouette = np.zeros((60, 60), np.float32), np.zeros((60, 60), np.bool_)
    mask[20:40, 20:40], silhouette[20:40, 25:45] = 1, True
    view = View(camera, np.full((60, 60, 3), 128, np.uint8), mask=mask)
    picture = np.asarray(pictured.residual_picture(silhouette, view, Rect(0, 0, 60, 60), width=60))
    assert tuple(picture[30, 22]) == pictured.MISSED
    assert tuple(picture[30, 42]) == pictured.EXCESS
    assert (picture[5, 5] == pictured.PAPER).all()
    assert len({tuple(p) for p in picture.reshape(-1, 3)}) == 4


def test_the_page_shows_stages_and_measures(record, pictures):
    page = Reader(render_reconstruction(record, pictures, "seed: 3", ["result.ply"]))
    before, after = (numbers["symmetric_iou"] for numbers in record.measures.groups["inputs"])
    for words in (
        "red cube",
        "Refined",
        f"{before:.4f} → {after:.4f}",
        "seed: 3",
        "result.ply",
        "None given",
    ):
        assert words in page.text, words
    for stage in record.result.stages:
        assert stage.status in page.text
        assert stage.reason[1:] in page.text  # its first letter became a capital
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    anchors = {a["href"][1:] for t, a in page.tags if t == "a" and a["href"].startswith("#")}
    assert anchors <= set(ids)
    sources = [attributes["src"] for tag, attributes in page.tags if tag in ("img", "video")]
    assert len(sources) >= 5 * len(record.views)
    assert all(source.startswith("data:") for source in sources)


def test_the_page_does_without_measures_and_pictures(record):
    bare = replace(record, measures=None, timings={})
    page = Reader(render_reconstruction(bare, ()))
    assert "Nothing was measured." in page.text
    assert "no pictures were made" in page.text


def test_hostile_names_stay_text(record):
    evil = "<img src=x onerror=alert(1)>"
    stage = StageReport("soft_hull", "applied", evil, {evil: float("nan")}, {evil: float("inf")})
    hostile = replace(
        record,
        name=evil,
        folder=evil,
        choices={evil: evil},
        notes=(evil,),
        result=replace(record.result, stages=(stage,), g0=replace(record.result.g0, status=evil)),
    )
    source = render_reconstruction(hostile, (), evil)
    assert evil not in source
    assert evil in Reader(source).text
