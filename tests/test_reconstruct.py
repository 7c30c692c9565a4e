"""`gvla2 reconstruct`: the real command from folders of views to geometry, numbers and a page."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from gvla2 import cli
from gvla2.commands.hydra_job import schemas, suite_schemas
from gvla2.commands.reconstruct import ReconstructConfig, reconstruct
from gvla2.component import Component, ComponentConfig
from gvla2.errors import ConfigurationError, GeometryError
from gvla2.evaluation.metrics import chamfer, surface_points
from gvla2.evaluation.protocol import protocol_cameras
from gvla2.geometry.gaussians import read_gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh, write_mesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.view_folders import write_plain
from gvla2.geometry.views import View, Views
from gvla2.plugins.discovery import Plugin
from gvla2.plugins.hydra_config import register
from gvla2.plugins.kinds import KINDS
from gvla2.plugins.registry import Offer, Registry
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.options import BranchOptions
from tests import composing
from tests.scanning import write_gso

ELEPHANT = Path(__file__).parent / "data" / "gso30_elephant"
SCHEMA = {"reconstruct": ReconstructConfig}
FAST = ("quiet=true", "reconstructor.resolution=32", "reconstructor.gaussians=2000")
BARE = ("prior=none", "axis=none", "fusion=none")
"""Without the branch: enough for tests of reading and reporting."""


def mallet() -> trimesh.Trimesh:
    """A head and a handle, longest side 1, centred."""
    head = trimesh.creation.cylinder(radius=0.2, height=0.6, sections=32)
    handle = trimesh.creation.box((0.8, 0.12, 0.12), trimesh.transformations.translation_matrix([0.4, 0, 0]))
    solid = trimesh.util.concatenate([head, handle])
    solid.apply_translation(-solid.bounds.mean(axis=0))
    return solid


def seen(solid: trimesh.Trimesh, count: int, size: int = 96) -> Views:
    cameras = protocol_cameras("mallet", size)[:count]
    shots = RayCaster([Surface(solid.vertices, solid.faces, np.array([0.7, 0.4, 0.2]), 0)]).cast(cameras, {})
    rows = zip(cameras, shots, strict=True)
    return Views(tuple(View(c, s.image, s.depth, (s.ids == 0).astype(np.float32)) for c, s in rows))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven views of a mallet in a plain folder, with its true mesh beside it."""
    place = tmp_path_factory.mktemp("views") / "mallet"
    solid = mallet()
    write_plain(place, seen(solid, 7))
    write_mesh(place.parent / "truth.obj", TriangleMesh(solid.vertices, solid.faces))
    return place


@pytest.fixture(autouse=True)
def _registered(registry: Registry) -> None:
    """Hydra knows the installed plugins."""
    register(registry, SCHEMA)


def composed(views: Path, *overrides: str) -> ReconstructConfig:
    config = composing.composed("reconstruct", *FAST, f"views='{views}'", *overrides)
    assert isinstance(config, ReconstructConfig)
    return config


def with_component(registry: Registry, kind: str, build) -> Registry:
    """The registry with one more component of the kind, called ``own``."""
    offers = {k: registry.offers(k) for k in KINDS}
    offers[kind]["own"] = Offer(Component("own", ComponentConfig, build), Plugin("test"))
    return Registry(offers, registry.plugins)


@pytest.fixture(scope="module")
def run(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command leaves of the mallet."""
    out = tmp_path_factory.mktemp("run")
    words = [f"views={folder}", "views_spec=0-4", "targets=5-6", f"truth={folder.parent / 'truth.obj'}"]
    assert cli.main(["reconstruct", *FAST, *words, "prior=depth", f"hydra.run.dir={out}"]) == 0
    return out


def test_the_command_leaves_geometry_numbers_and_a_page(run: Path):
    names = {p.name for p in run.iterdir() if not p.name.startswith(".")}
    assert names == {
        "config.yaml", "index.html", "reconstruct.log", "result.glb", "result.json", "result.ply",
    }  # fmt: skip
    reported = json.loads((run / "result.json").read_text())
    gaussians, mesh = read_gaussians(run / "result.ply"), read_mesh(run / "result.glb")
    assert reported["gaussians"] == len(gaussians) > 1000
    assert reported["faces"] == len(mesh.faces) > 1000
    for points in (gaussians.centres, mesh.vertices):  # both in the views' frame, Z-up
        np.testing.assert_allclose(np.ptp(points, axis=0), mallet().extents, atol=0.12)
    assert mesh.colours is not None
    page = (run / "index.html").read_text()
    assert page.count('src="data:image/') == 5 * 5, "of each view its photo, two renders and two silhouettes"
    assert "http" not in page.replace("http-equiv", ""), "the page loads nothing"


def test_the_result_has_choices_stages_and_measures(run: Path):
    reported = json.loads((run / "result.json").read_text())
    assert reported["command"] == "reconstruct"
    assert reported["object"] == "mallet"
    assert reported["views"]["names"] == ["000", "001", "002", "003", "004"]
    assert reported["choices"] == {
        "reconstructor": "hull",
        "prior": "depth",
        "axis": "contours",
        "fusion": "residual",
        "renderer": "numba",
    }
    assert {"drift", "prior", "appearance", "fusion", "inset"} <= {
        stage["stage"] for stage in reported["stages"]
    }
    assert all(stage["reason"] for stage in reported["stages"])
    assert reported["metrics"]["held_out_views"] == ["005", "006"]
    for group, name in (("inputs", "symmetric_iou"), ("held_out", "psnr"), ("truth", "cd_surface")):
        assert all(reported["metrics"][group][when][name] > 0 for when in ("before", "after"))
    distances = [reported["metrics"]["truth"][when]["cd_surface"] for when in ("before", "after")]
    assert distances[1] < 1.01 * distances[0]
    assert reported["metrics"]["inputs"]["after"]["symmetric_iou"] > 0.9


def test_a_planted_drift_is_undone_and_reported(folder: Path, tmp_path: Path, registry: Registry):
    """The mended object is nearer to the truth, and the page's numbers say so."""

    class Drifted:
        def reconstruct(self, views: Views) -> Reconstruction:
            made = registry.build({"reconstructor": {"name": "hull", "resolution": 32}}, "reconstructor")
            carved = made.reconstruct(views)
            stretch, shift = np.array([1.05, 0.95, 1.04]), np.array([0.02, -0.01, 0.015])
            return replace(
                carved,
                gaussians=carved.gaussians.with_centres(carved.gaussians.centres * stretch + shift),
                mesh=carved.mesh.with_vertices(carved.mesh.vertices * stretch + shift),
            )

    drifting = with_component(registry, "reconstructor", lambda config: Drifted())
    register(drifting, SCHEMA)
    config = composing.composed("reconstruct", "reconstructor=own", f"views={folder}", "quiet=true")
    record = reconstruct(config, drifting, tmp_path)
    reported = record.summary()["metrics"]
    solid = mallet()
    truth = cKDTree(TriangleMesh(solid.vertices, solid.faces).sample(5000, np.random.default_rng(0))[0])
    ends = [surface_points(end.mesh, None, samples=5000)[0] for end in (record.result.g0, record.result.out)]
    before, after = (chamfer(points, truth) for points in ends)
    assert after < 0.9 * before
    assert reported["inputs"]["after"]["symmetric_iou"] > reported["inputs"]["before"]["symmetric_iou"] + 0.03
    assert record.changed
    assert 0.01 < record.displacement / record.size < 0.1
    assert "Refined" in (tmp_path / "index.html").read_text()


def test_a_gso_trees_first_views_are_the_input(tmp_path: Path, registry: Registry):
    write_gso(tmp_path / "mallet" / "render_mvs_25" / "model", seen(mallet(), 12, 64))
    asked = composed(tmp_path / "mallet", *BARE, "size=64", "targets=10-11")
    record = reconstruct(asked, registry, tmp_path / "out")
    assert [view.name for view in record.views] == ["000", "001", "002", "003", "004"]
    assert record.measures.held_out == ("010", "011")


def test_a_real_scan(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = [f"views={ELEPHANT}", "quiet=true", "targets=10-14", f"hydra.run.dir={tmp_path}"]
    assert (
        cli.main(["reconstruct", *words, "reconstructor.resolution=64", "reconstructor.gaussians=6000"]) == 0
    )
    result, page = capsys.readouterr().err.splitlines()
    assert "symmetric IoU" in result, "quiet=true prints the result, as `gvla2 run` does"
    assert page == f"-> {tmp_path / 'index.html'}"
    reported = json.loads((tmp_path / "result.json").read_text())
    assert reported["metrics"]["inputs"]["after"]["symmetric_iou"] > 0.95
    assert len(reported["metrics"]["held_out_views"]) == 5
    held_out = reported["metrics"]["held_out"]
    assert held_out["after"]["psnr"] > 0.99 * held_out["before"]["psnr"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "views=FOLDER"),
        (["views=nowhere"], "no such folder"),
        (["views={folder}", "views_spec=0-9"], "There is no view 7"),
        (["views={folder}", "views_spec=0-3", "targets=3-5"], "both input and target"),
        (["views={folder}", "truth=nowhere.obj"], "no such file"),
        (["views={folder}", "reconstructor=none"], "Choose another with reconstructor=NAME: "),
    ],
)
def test_bad_requests_are_one_message(
    folder: Path, tmp_path: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    asked = [word.format(folder=folder) for word in words]
    assert cli.main(["reconstruct", "quiet=true", *asked, f"hydra.run.dir={tmp_path}"]) == 1
    err = capsys.readouterr().err
    assert err.startswith("gvla2: ")
    assert message in err
    assert "Traceback" not in err
    assert not (tmp_path / "result.json").exists()


def test_truth_in_another_frame_is_refused_early(folder: Path, tmp_path: Path, registry: Registry):
    solid = mallet()
    write_mesh(tmp_path / "far.obj", TriangleMesh(solid.vertices + 5.0, solid.faces))
    with pytest.raises(GeometryError, match="frame and scale"):
        reconstruct(composed(folder, f"truth={tmp_path / 'far.obj'}"), registry, tmp_path / "out")


def test_a_picture_that_fails_costs_no_geometry(
    folder: Path, tmp_path: Path, registry: Registry, monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: object) -> None:
        raise RuntimeError("the display is gone")

    monkeypatch.setattr("gvla2.record.reconstruction.view_pictures", fail)
    reconstruct(composed(folder, "views_spec=0-2"), registry, tmp_path)
    reported = json.loads((tmp_path / "result.json").read_text())
    assert any("the display is gone" in note for note in reported["notes"])
    assert (tmp_path / "result.ply").is_file()


@pytest.mark.parametrize("command", ["run", "reconstruct", "bench"])
def test_the_branch_is_one_group_of_three_commands(registry: Registry, command: str):
    register(registry, schemas() | suite_schemas())
    chosen = composing.composed(command, "branch=paper", "branch.axis=false")
    assert chosen.branch == BranchOptions(mode="paper", axis=False, soft_hull=True, fusion=True)


@pytest.mark.parametrize(("word", "spec"), [("0-4", "0-4"), ("7", "7"), ("[0-4,7]", "0-4,7"), ("null", None)])
def test_view_specs_as_the_command_line_has_them(folder: Path, word: str, spec: str | None):
    assert composed(folder, f"views_spec={word}").views_spec == spec


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("branch.mode=papr", "branch.mode is 'papr'; it is one of default, paper"),
        ("branch.eta=0", "eta > 0"),
        ("size=4", "at least 8"),
        ("views_spec=true", "write views such as"),
    ],
)
def test_values_that_cannot_be_are_refused(folder: Path, word: str, message: str):
    with pytest.raises(ConfigurationError, match=message):
        composed(folder, word)
