"""The same sweep by joblib, on a Ray cluster and by submitit: all run every job and find the same.

The cluster is real and local: the test starts it, sweeps on it by its address, and shuts it down. Submitit's local
executor starts the processes that it would hand to Slurm.
"""

import importlib.util
import json
import os
import secrets
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gvla2.evaluation.protocol import protocol_cameras
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.view_folders import write_plain
from gvla2.geometry.views import View, Views

CLUSTER = """
import json, sys, ray
ray.init(num_cpus=2, object_store_memory=80_000_000, include_dashboard=False, logging_level="ERROR")
print(json.dumps(ray.get_runtime_context().gcs_address), flush=True)
sys.stdin.read()  # until the test lets go
ray.shutdown()
"""
FAST = ("quiet=true", "reconstructor.resolution=16", "reconstructor.gaussians=300")
TIMEOUT = 240

# A cluster runs whatever it is sent: this one takes work of those only who know a word made up here. Given in the
# environment, it leaves no file in the home folder.
ENVIRONMENT = {
    **os.environ,
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
}


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three views of a block in a folder."""
    block = trimesh.creation.box((1.0, 0.6, 0.4))
    cameras = protocol_cameras("block", 48)[:3]
    colour = np.array([0.7, 0.4, 0.2])
    shots = RayCaster([Surface(block.vertices, block.faces, colour, 0)]).cast(cameras, {})
    rows = zip(cameras, shots, strict=True)
    folder = tmp_path_factory.mktemp("views") / "block"
    write_plain(
        folder, Views(tuple(View(c, s.image, None, (s.ids == 0).astype(np.float32)) for c, s in rows))
    )
    return folder


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[str]:
    """HOST:PORT of a Ray cluster of two workers, which ends with the test."""
    for module in ("ray", "hydra_plugins.hydra_ray_launcher"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    with (tmp_path / "cluster.log").open("w") as log:
        head = subprocess.Popen(
            [sys.executable, "-c", CLUSTER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            env=ENVIRONMENT,
            cwd=tmp_path,
        )
        try:
            assert head.stdout is not None
            line = head.stdout.readline()
            assert line, (tmp_path / "cluster.log").read_text()
            yield json.loads(line)
        finally:
            head.communicate(timeout=60)
    assert head.returncode == 0


def gvla2(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gvla2.cli", *arguments],
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )


def sweep(folder: Path, views: Path, *launcher: str) -> dict[str, tuple[dict, bytes]]:
    """Two jobs that differ in their views: by the job's folder its result, times left out, and its Gaussians.

    The folder is given as a whole path: workers on a cluster start in folders of their own.
    """
    folder.mkdir()
    done = gvla2(
        *(folder, "reconstruct", "-m", f"views={views}", *FAST, "views_spec=0-1,0-2"),
        *(f"hydra.sweep.dir={folder / 'swept'}", "hydra.sweep.subdir=${hydra.job.num}", *launcher),
    )
    assert done.returncode == 0, done.stderr
    found = {}
    for path in sorted((folder / "swept").glob("*/result.json")):
        result = without_times(json.loads(path.read_text()))
        found[path.parent.name] = (result, (path.parent / "result.ply").read_bytes())
    return found


def without_times(value):
    if isinstance(value, dict):
        return {
            key: without_times(inner) for key, inner in value.items() if key not in ("seconds", "timings")
        }
    return [without_times(inner) for inner in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def joblib(views: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[dict, bytes]]:
    folder = tmp_path_factory.mktemp("joblib") / "jobs"
    return sweep(folder, views, "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")


@pytest.mark.timeout(2 * TIMEOUT)
def test_joblib_and_ray_find_the_same(views: Path, joblib: dict, cluster: str, tmp_path: Path):
    ray = sweep(
        tmp_path / "ray",
        views,
        "hydra/launcher=ray",
        f"hydra.launcher.ray.init.address={cluster}",
        "+hydra.launcher.ray.init.object_store_memory=null",  # a cluster that stands has its own
    )
    assert list(joblib) == ["0", "1"]
    assert [joblib[job][0]["views"]["count"] for job in joblib] == [2, 3]
    assert ray == joblib


@pytest.mark.timeout(2 * TIMEOUT)
def test_joblib_and_submitit_find_the_same(views: Path, joblib: dict, tmp_path: Path):
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher", reason="pip install 'gvla2[slurm]'")
    submitit = sweep(
        tmp_path / "submitit", views, "hydra/launcher=submitit_local", "hydra.launcher.timeout_min=3"
    )
    assert submitit == joblib
