from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.evaluation.protocol import object_views
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.rasteriser import Rasteriser
from gvla2.testing import check_component, inputs
from gvla2.testing.reconstruction import check_reconstructor
from gvla2_plugins.splat import SplatConfig, gvla2_reconstructors

SCANS = Path(__file__).parents[1] / "data" / "ycb30"
QUICK = {"resolution": 48, "gaussians": 2500, "shape_iterations": 40, "iterations": 20}


def build(**options: object):
    [component] = gvla2_reconstructors()
    assert component.name == "splat"
    return component.build(SplatConfig(name="splat", **options))


def psnr(gaussians: Gaussians, views: Views) -> float:
    errors = [
        np.mean((Rasteriser().render(gaussians, view.camera)[0] - view.image / 255.0) ** 2) for view in views
    ]
    return float(np.mean(-10 * np.log10(errors)))


def test_conformance() -> None:
    check_component(*gvla2_reconstructors())
    check_reconstructor(build(**QUICK))


def test_it_is_the_hull_s_topology_whether_or_not_the_mesh_is_carried() -> None:
    views = inputs.views(masked=inputs.RED)
    hull = carve(views, 48).to_reconstruction(2500)
    kept = build(**QUICK, carry_mesh=False).reconstruct(views)
    carried = build(**QUICK).reconstruct(views)
    assert np.array_equal(kept.mesh.vertices, hull.mesh.vertices)
    assert np.array_equal(carried.mesh.faces, hull.mesh.faces)
    assert len(carried.gaussians) == len(hull.gaussians)
    assert not np.array_equal(carried.gaussians.centres, hull.gaussians.centres)
    assert carried.status == hull.status


@pytest.mark.parametrize("name", ["banana", "rubiks_cube"])
def test_views_it_never_saw_look_better_than_the_hull_s(name: str, tmp_path: Path) -> None:
    scan = object_views(SCANS / name / "textured.obj", size=96, samples=2, cache=tmp_path)
    hull = carve(scan.inputs, 64).to_reconstruction(4000)
    made = build(resolution=64, gaussians=4000, shape_iterations=60, iterations=40).reconstruct(scan.inputs)
    assert psnr(made.gaussians, scan.targets) > psnr(hull.gaussians, scan.targets) + 1.0


def test_no_mask_is_an_error_and_so_are_senseless_options() -> None:
    with pytest.raises(GeometryError):
        build().reconstruct(inputs.views())
    for options in ({"gaussians": 0}, {"iterations": -1}, {"shape_iterations": -1}, {"resolution": 4}):
        with pytest.raises(ConfigurationError, match=next(iter(options))):
            build(**options)
