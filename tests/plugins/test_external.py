import os
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gvla2.errors import ConfigurationError, GeometryError, Gvla2Error, MissingDependencyError
from gvla2.geometry.gaussians import write_gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import write_mesh
from gvla2.geometry.transform import transform_points
from gvla2.geometry.view_folders import read_views
from gvla2.reconstruction.surfels import surfels
from gvla2.testing import inputs
from gvla2_plugins.geofuse import gvla2_reconstructors

COMPONENT = next(c for c in gvla2_reconstructors() if c.name == "mv_sam3d")


@pytest.fixture
def views():
    return inputs.views(masked=inputs.RED)


@pytest.fixture
def checkout(tmp_path):
    """Stands for a user's checkout: a script that copies a prepared result to where the real one would put it."""
    folder = tmp_path / "checkout"
    (folder / "checkpoints" / "hf").mkdir(parents=True)
    (folder / "checkpoints" / "hf" / "pipeline.yaml").touch()
    cube = trimesh.creation.box((0.052,) * 3).subdivide().subdivide()
    mesh = TriangleMesh(transform_points(inputs.RED.world_from_block, cube.vertices), cube.faces)
    write_mesh(folder / "cube.glb", mesh)
    write_gaussians(folder / "cube.ply", surfels(mesh, None, 500))
    return folder


def _script(checkout, name, body):
    path = checkout / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("import os, sys, shutil, time, pathlib\nargs = sys.argv[1:]\n" + textwrap.dedent(body))


def _build(checkout, **options):
    options = {"python": sys.executable, "checkout": str(checkout), "timeout_s": 60.0, **options}
    return COMPONENT.build(COMPONENT.config(**options))


MV = """
    scene = pathlib.Path(args[args.index("--input_path") + 1])
    prompt = args[args.index("--mask_prompt") + 1]
    for i in range(3):
        assert (scene / "images" / f"{i}.png").is_file() and (scene / prompt / f"{i}.png").is_file()
    shutil.copytree(scene, "scene_as_given")
    out = pathlib.Path("visualization") / scene.name / prompt / "run_1"
    out.mkdir(parents=True)
    shutil.copy("cube.ply", out / "result.ply")
    shutil.copy("cube.glb", out / "result.glb")
    shutil.copy("cube.glb", out / "result_merged_scene.glb")
"""


def test_a_run_of_mv_sam3d(views, checkout):
    _script(checkout, "run_inference_weighted.py", MV)
    made = _build(checkout).reconstruct(views)
    assert made.status == "ok"
    np.testing.assert_allclose(
        made.gaussians.centres.mean(axis=0), inputs.RED.world_from_block[:3, 3], atol=0.01
    )
    # The scene that the program was given can be read again, with the true cameras.
    again = read_views(checkout / "scene_as_given")
    np.testing.assert_allclose(
        again[1].camera.world_from_camera, views[1].camera.world_from_camera, atol=1e-9
    )
    np.testing.assert_array_equal(again[1].mask, views[1].mask)


def test_a_program_that_fails(views, checkout):
    _script(checkout, "run_inference_weighted.py", 'print("loading"); sys.exit("CUDA is required")')
    with pytest.raises(Gvla2Error, match=r"MV-SAM3D ended with exit status 1(.|\n)*CUDA is required"):
        _build(checkout).reconstruct(views)


def test_a_program_that_hangs_is_ended_with_its_children(views, checkout):
    _script(
        checkout,
        "run_inference_weighted.py",
        """
        import subprocess
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"])
        pathlib.Path("child.txt").write_text(str(child.pid))
        print("working", flush=True)
        time.sleep(300)
        """,
    )
    start = time.monotonic()
    with pytest.raises(Gvla2Error, match=r"ended after 1.5 s; reconstructor\.timeout_s(.|\n)*working"):
        _build(checkout, timeout_s=1.5).reconstruct(views)
    assert time.monotonic() - start < 20
    child = int((checkout / "child.txt").read_text())
    for _ in range(50):
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            break
        # An orphan whose parent has not collected it yet is dead, too.
        if Path(f"/proc/{child}/stat").read_text().split()[2] == "Z":
            break
        time.sleep(0.1)
    else:
        pytest.fail("The program's child lives on.")


def test_a_program_that_leaves_nothing_or_rubbish(views, checkout):
    _script(checkout, "run_inference_weighted.py", "pass")
    with pytest.raises(Gvla2Error, match="left no result; looked for visualization/"):
        _build(checkout).reconstruct(views)
    _script(
        checkout,
        "run_inference_weighted.py",
        MV.replace('shutil.copy("cube.ply", out / "result.ply")', '(out / "result.ply").write_text("ply")'),
    )
    with pytest.raises(GeometryError, match=r"result\.ply"):
        _build(checkout).reconstruct(views)


def test_what_is_missing_is_named(checkout, tmp_path):
    with pytest.raises(MissingDependencyError, match=r"git clone https://github\.com/.*licence"):
        _build("")
    with pytest.raises(MissingDependencyError, match="nowhere"):
        _build(tmp_path / "nowhere")
    with pytest.raises(MissingDependencyError, match=r"no .*\.py in reconstructor\.checkout"):
        _build(checkout)
    _script(checkout, "run_inference_weighted.py", "")
    _build(checkout)
    (checkout / "checkpoints" / "hf" / "pipeline.yaml").unlink()
    with pytest.raises(MissingDependencyError, match=r"the weights(.|\n)*Hugging Face(.|\n)*SAM License"):
        _build(checkout)


def test_options_that_cannot_be(checkout, views):
    _script(checkout, "run_inference_weighted.py", "")
    with pytest.raises(ConfigurationError, match="timeout_s"):
        _build(checkout, timeout_s=0.0)
    with pytest.raises(MissingDependencyError, match="no-such-python"):
        _build(checkout, python="no-such-python").reconstruct(views)
    with pytest.raises(GeometryError, match="No view has a mask"):
        _build(checkout).reconstruct(inputs.views())
