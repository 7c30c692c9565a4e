"""The benchmark from end to end on two small objects: rows, resuming, failures, worker processes."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from rich.console import Console

from gvla2.commands import doctor
from gvla2.commands.bench import run_bench
from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.config import DataConfig, ReconstructionBench, ResultsConfig
from gvla2.evaluation.engine import BenchProgress, in_processes
from gvla2_plugins import axes, depth_prior, geofuse

FACTORS = {"object", "baseline", "drift", "variant", "seed"}
MEASURES = {"cd_surface", "cd_official", "psnr", "ssim", "seconds"}


@pytest.fixture(scope="module")
def meshes(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("meshes")
    for name, extents in (("brick", (0.1, 0.06, 0.04)), ("pillar", (0.03, 0.04, 0.12))):
        (root / name).mkdir()
        box = trimesh.creation.box(extents=extents).subdivide().subdivide()
        shade = np.rint(120 + 100 * np.sin(90 * box.vertices))
        trimesh.Trimesh(box.vertices, box.faces, vertex_colors=shade.astype(np.uint8)).export(
            root / name / "textured.glb"
        )
    return root


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("GVLA2_CACHE", str(tmp_path_factory.getbasetemp() / "bench_cache"))


def config_for(meshes: Path, tmp_path: Path, objects: tuple[str, ...] = (), **changes) -> ReconstructionBench:
    settings = {
        "data": DataConfig("meshes", str(meshes), size=40, samples=1, objects=list(objects)),
        "baselines": ["hull"],
        "baseline_options": {"hull": {"resolution": 32, "gaussians": 1500}},
        "seeds": [0],
        "surface_samples": 5000,
        "prior": depth_prior.DepthPriorConfig(name="depth"),
        "axis": axes.ContoursConfig(name="contours"),
        "fusion": geofuse.ShareConfig(name="residual"),
        "renderer": geofuse.NumbaRendererConfig(name="numba"),
        "results": ResultsConfig(f"sqlite:///{tmp_path / 'results.sqlite'}"),
        "workers": 1,
        "quiet": True,
    }
    return ReconstructionBench(**{**settings, **changes})


def rows_of(folder: Path) -> list[dict]:
    return json.loads((folder / "result.json").read_text())["rows"]


def test_every_cell_of_the_design_is_a_row_and_is_measured_once(meshes, registry, tmp_path, capsys):
    variants = ["baseline", "ab_fusion"]  # the others switch other stages off
    config = config_for(meshes, tmp_path, ("brick",), variants=variants)
    assert run_bench(config, registry, tmp_path / "first") == 1
    rows = rows_of(tmp_path / "first")
    assert len(rows) == 2 * len(variants)
    for row in rows:
        assert row.keys() >= FACTORS | MEASURES
        assert row["status"] == "ok"
        assert row["cd_points"] == "mesh"
        assert 0 < row["cd_surface"] < 200
        assert 0 < row["cd_official"] < 200
        assert 5 < row["psnr"] < 60
        assert 0 < row["ssim"] <= 1
        assert row["seconds"] > 0
    calm, planted = (
        r for drift in ("none", "planted") for r in rows if (r["drift"], r["variant"]) == (drift, "baseline")
    )
    assert planted["psnr"] < calm["psnr"], "the drift does harm"
    assert "A + B fusion" in (tmp_path / "first" / "index.html").read_text()

    assert run_bench(config, registry, tmp_path / "second") == 1
    again = rows_of(tmp_path / "second")
    assert again == rows, "the same numbers to the last digit, seconds included: nothing was run again"

    one = config_for(meshes, tmp_path, variants=["baseline"], drifts=["planted"], seeds=[0, 1])
    run_bench(one, registry, tmp_path / "third")
    third = rows_of(tmp_path / "third")
    places = [(row["object"], row["seed"]) for row in third]
    assert places == [("brick", 0), ("brick", 1), ("pillar", 0), ("pillar", 1)]
    assert [row["run"] for row in third] == [1, 3, 3, 3]
    assert len({row["cd_surface"] for row in third}) == 4, "each seed has a drift of its own"

    fresh = config_for(meshes, tmp_path, ("brick",), variants=["baseline"], drifts=["none"])
    fresh.results.fresh = True
    run_bench(fresh, registry, tmp_path / "fourth")
    (row,) = rows_of(tmp_path / "fourth")
    assert (row["run"], row["object"]) == (4, calm["object"])
    assert row["cd_surface"] == calm["cd_surface"], "measuring anew gives the same"


def test_an_object_that_cannot_be_read_is_a_failed_row_and_tried_again(meshes, registry, tmp_path):
    root = tmp_path / "objects"
    shutil.copytree(meshes, root)
    (root / "pillar" / "textured.glb").write_bytes(b"not a mesh")
    config = config_for(root, tmp_path, variants=["baseline"], drifts=["none"])
    assert run_bench(config, registry, tmp_path / "first") == 0.5
    good, bad = rows_of(tmp_path / "first")
    assert good["status"] == "ok"
    assert bad["status"].startswith("failed: ")
    assert bad["psnr"] is None
    shutil.copy(meshes / "pillar" / "textured.glb", root / "pillar" / "textured.glb")
    assert run_bench(config, registry, tmp_path / "second") == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"variants": ["a_hull"]}, "No variant 'a_hull'. Available: baseline"),
        ({"drifts": ["big"]}, "No drift 'big'. Available: none, planted"),
        ({"baselines": ["hul"]}, "Did you mean 'hull'"),
        ({"baseline_options": {"hull": {"sides": 3}}}, "sides"),
        ({"noise": ["low3"]}, "No noise 'low3'. Available: exact"),
        ({"noise": ["low1"], "prior": ComponentConfig(name="none")}, "needs prior=depth, not none"),
    ],
)
def test_what_cannot_be_is_an_error_before_anything_runs(meshes, registry, tmp_path, changes, message):
    with pytest.raises(Gvla2Error) as shown:
        run_bench(config_for(meshes, tmp_path, **changes), registry, tmp_path / "out")
    assert message in str(shown.value)
    assert not (tmp_path / "out" / "result.json").exists()


@pytest.mark.parametrize("changes", [{"seeds": []}, {"workers": -1}, {"seeds": [-1]}, {"surface_samples": 1}])
def test_nonsense_in_the_configuration(changes):
    with pytest.raises(ConfigurationError):
        ReconstructionBench(**changes)


def test_an_error_of_a_worker_process_comes_back():
    with pytest.raises(ValueError, match=r"math domain error|nonnegative"):
        list(in_processes(math.sqrt, [-1.0], 1))


def test_progress_without_a_terminal(capsys):
    console = Console(stderr=True, force_terminal=False)
    with BenchProgress(4, console=console) as progress:
        progress.report(2, "brick, hull")
        progress.report(2, "pillar, hull")
    assert "4 of 4 cells, pillar, hull" in capsys.readouterr().err
    with BenchProgress(4, quiet=True, console=console) as progress:
        progress.report(4, "brick")
    assert capsys.readouterr().err == ""


def test_the_doctor_says_which_data_are_here_and_how_to_get_the_others(tmp_path, monkeypatch):
    monkeypatch.setenv("GVLA2_DATA", str(tmp_path))
    monkeypatch.setenv("GVLA2_CACHE", str(tmp_path / "empty"))
    (tmp_path / "gso30" / "toy" / "render_mvs_25" / "model").mkdir(parents=True)
    (tmp_path / "gso30" / "toy" / "render_mvs_25" / "model" / "000.png").write_bytes(b"")
    assert f"gso30: 1 objects in {tmp_path / 'gso30'}" in doctor.data().found
