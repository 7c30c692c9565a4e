from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.evaluation.protocol import object_views
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.rasteriser import Rasteriser
from gvla2.reconstruction.surfels import surfels
from gvla2.testing import check_component, inputs
from gvla2.testing.reconstruction import check_reconstructor
from gvla2_plugins.splat import SplatConfig, gvla2_reconstructors, splatting
from gvla2_plugins.splat.splatting import MARGIN, carry, optimise, targets

RADIUS = 0.4
CONFIG = SplatConfig(name="splat")
SCANS = Path(__file__).parents[1] / "data" / "ycb30"
QUICK = {"resolution": 48, "gaussians": 2500, "shape_iterations": 40, "iterations": 20}
FIELDS = ("centres", "log_scales", "rotations", "opacity_logits", "sh_dc")


def paint(directions: np.ndarray) -> np.ndarray:
    return 0.5 + 0.35 * np.sin(directions @ np.array([[5.0, 1, 2], [1, -6, 2], [-2, 1, 7]]))


def look_from(direction: np.ndarray, size: int = 80) -> Camera:
    direction = direction / np.linalg.norm(direction)
    return Camera.from_fov(0.62, look_along(1.6 * direction, -direction), size, size)


@pytest.fixture(scope="module")
def ball() -> tuple[Views, Views]:
    """A painted ball from five sides, and from eight others."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    caster = RayCaster([Surface(mesh.vertices, mesh.faces, paint(middles / RADIUS), 0)], (1.0, 1.0, 1.0))

    def views(directions: np.ndarray) -> Views:
        cameras = [look_from(d) for d in directions]
        return Views(
            tuple(
                View(camera, seen.image, None, (seen.ids == 0).astype(np.float32))
                for camera, seen in zip(cameras, caster.cast(cameras, {}), strict=True)
            )
        )

    rng = np.random.default_rng(4)
    five = np.array([[1.0, 0.2, 0.4], [-0.8, 0.9, 0.1], [-0.5, -1, -0.3], [0.3, 0.5, -1], [0.2, -0.7, 1]])
    return views(five), views(rng.normal(size=(8, 3)))


def lumpy(count: int = 1500) -> Gaussians:
    """The ball as a careless reconstruction: too large, uneven, with blurred colours."""
    mesh = trimesh.creation.icosphere(subdivisions=4)
    directions = np.asarray(mesh.vertices)
    colours = 0.5 + 0.6 * (paint(directions) - 0.5)
    uneven = directions * (1.04 + 0.03 * np.sin(4 * directions[:, :1])) * RADIUS
    return surfels(TriangleMesh(uneven, mesh.faces, colours), directions, count)


def psnr(gaussians: Gaussians, views: Views) -> float:
    errors = [
        np.mean((Rasteriser().render(gaussians, view.camera)[0] - view.image / 255.0) ** 2) for view in views
    ]
    return float(np.mean(-10 * np.log10(errors)))


def test_held_out_views_and_the_shape_get_better(ball: tuple[Views, Views]) -> None:
    inputs, others = ball
    start = lumpy()
    fitted, report = optimise(start, inputs, CONFIG, 60)
    assert report.status == "applied"
    assert report.after["psnr"] > report.before["psnr"] + 2
    assert report.after["iou"] > report.before["iou"] + 0.02
    assert psnr(fitted, others) > psnr(start, others) + 1.5


def test_the_seed_decides(ball: tuple[Views, Views]) -> None:
    start = lumpy(500)
    one, same, other = (
        optimise(start, ball[0], SplatConfig(name="splat", seed=seed), 8)[0] for seed in (0, 0, 1)
    )
    for name in FIELDS:
        assert np.array_equal(getattr(one, name), getattr(same, name))
    assert not np.array_equal(one.centres, other.centres)


def test_without_anything_to_fit_nothing_changes(ball: tuple[Views, Views]) -> None:
    start = lumpy(50)
    empty = Gaussians(*(getattr(start, name)[:0] for name in FIELDS))
    dark = Views(tuple(replace(view, mask=np.zeros_like(view.mask)) for view in ball[0]))
    for gaussians, views, iterations in ((empty, ball[0], 9), (start, dark, 9), (start, ball[0], 0)):
        same, report = optimise(gaussians, views, CONFIG, iterations)
        assert same is gaussians
        assert report.status == "skipped"


def test_what_makes_the_inputs_worse_is_undone(ball: tuple[Views, Views], monkeypatch) -> None:
    monkeypatch.setattr(splatting, "_RATE_CENTRES", 40.0)
    start = lumpy(400)
    same, report = optimise(start, ball[0], SplatConfig(name="splat", smooth_centres=0.0), 6)
    assert report.status == "rejected"
    assert same is start
    assert report.after["psnr"] < report.before["psnr"]


def test_targets_are_cut_to_the_object_and_put_on_white(ball: tuple[Views, Views]) -> None:
    view = ball[0][0]
    shifted = np.zeros((80, 80), np.float32)
    shifted[20:40, 50:60] = 1.0
    shifted[40, 50:60] = 0.25
    grey = np.full((80, 80, 3), 51, np.uint8)
    robot = np.zeros((80, 80), np.bool_)
    robot[22:24] = True
    [target] = targets(Views((View(view.camera, grey, None, shifted, robot),)))
    assert target.mask.shape == (21 + 2 * MARGIN, 10 + 2 * MARGIN)
    assert np.allclose(target.image[0, 0], 1.0)
    assert np.allclose(target.image[MARGIN, MARGIN], 0.2)
    assert np.allclose(target.image[MARGIN + 20, MARGIN], 0.25 * 0.2 + 0.75)
    assert (target.weight[MARGIN + 2] == 0).all()
    assert target.weight[MARGIN, MARGIN] == pytest.approx(1 / 200)
    # The cut camera sees the same points at the same places.
    point = np.array([[0.1, 0.05, -0.1]])
    whole, part = view.camera.project(point)[0], target.camera.project(point)[0]
    assert np.allclose(whole - part, [50 - MARGIN, 20 - MARGIN])


def test_a_mesh_is_carried_by_the_gaussians_around_it() -> None:
    start = lumpy(800)
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=RADIUS)
    mesh = TriangleMesh(sphere.vertices, sphere.faces, np.full((len(sphere.vertices), 3), 0.5))
    moved = start.with_centres(start.centres + np.float32([0.1, 0.2, -0.3]))
    shifted = carry(mesh, start, moved)
    assert np.allclose(shifted.vertices - mesh.vertices, [0.1, 0.2, -0.3], atol=1e-6)
    assert shifted.faces is mesh.faces
    assert np.array_equal(shifted.colours, mesh.colours)
    assert np.array_equal(carry(mesh, start, start).vertices, mesh.vertices)
    # One half moves: the other half stays.
    half = start.with_centres(start.centres + np.where(start.centres[:, :1] > 0, np.float32(0.05), 0))
    gap = carry(mesh, start, half).vertices - mesh.vertices
    assert np.allclose(gap[mesh.vertices[:, 0] < -0.1], 0)
    assert np.allclose(gap[mesh.vertices[:, 0] > 0.1], 0.05, atol=1e-6)


def build(**options: object):
    [component] = gvla2_reconstructors()
    assert component.name == "splat"
    return component.build(SplatConfig(name="splat", **options))


def test_conformance() -> None:
    check_component(*gvla2_reconstructors())
    check_reconstructor(build(**QUICK))


def test_it_keeps_the_hulls_topology() -> None:
    views = inputs.views(masked=inputs.RED)
    hull = carve(views, 48).to_reconstruction(2500)
    made = build(**QUICK).reconstruct(views)
    assert np.array_equal(made.mesh.faces, hull.mesh.faces)
    assert len(made.gaussians) == len(hull.gaussians)
    assert not np.array_equal(made.gaussians.centres, hull.gaussians.centres)
    assert made.status == hull.status


@pytest.mark.parametrize("name", ["banana", "rubiks_cube"])
def test_views_it_never_saw_look_better_than_the_hulls(name: str, tmp_path: Path) -> None:
    scan = object_views(SCANS / name / "textured.obj", size=96, samples=2, cache=tmp_path)
    hull = carve(scan.inputs, 64).to_reconstruction(4000)
    made = build(resolution=64, gaussians=4000, shape_iterations=60, iterations=40).reconstruct(scan.inputs)
    assert psnr(made.gaussians, scan.targets) > psnr(hull.gaussians, scan.targets) + 1.0


def test_no_mask_is_an_error_and_so_are_options_out_of_range() -> None:
    with pytest.raises(GeometryError):
        build().reconstruct(inputs.views())
    for options in ({"gaussians": 0}, {"iterations": -1}, {"shape_iterations": -1}, {"resolution": 4}):
        with pytest.raises(ConfigurationError, match=next(iter(options))):
            build(**options)
