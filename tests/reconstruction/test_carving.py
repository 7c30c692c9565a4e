from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import look_along
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.silhouette import mask_agreement, mask_silhouettes


def agreement(made, views):
    return mask_agreement(made.mesh, mask_silhouettes(views)[0])


def _ball(radius=0.5, shift=(0, 0, 0)):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    ball.apply_translation(shift)
    return ball


def _without(views, *empty):
    return Views(
        tuple(replace(v, mask=np.zeros_like(v.mask)) if i in empty else v for i, v in enumerate(views))
    )


def test_a_ball_is_found_far_more_finely_than_the_grid(masked_views):
    views = masked_views(_ball(), count=30, size=256, seed=1)
    made = carve(views, resolution=40)
    reach = np.linalg.norm(made.mesh.vertices, axis=1)
    # The hull of many views touches the ball and lies outside it; a pixel is 6 mm here, a voxel 25 mm.
    assert reach.min() > 0.5 - 0.004
    assert np.median(reach) < 0.5 + 0.008
    assert made.status == "ok"
    assert agreement(made, views) > 0.98


def test_the_surface_is_closed_and_faces_outward(masked_views, jug):
    made = carve(masked_views(jug, count=8, size=192), resolution=64)
    solid = trimesh.Trimesh(made.mesh.vertices, made.mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.volume > 0
    np.testing.assert_allclose(np.linalg.norm(made.normals, axis=1), 1.0, atol=1e-6)
    assert np.median(np.einsum("ij,ij->i", made.normals, solid.vertex_normals)) > 0.95


def test_views_that_leave_the_depth_open_are_refused(masked_views):
    views = masked_views(_ball(), count=3)
    with pytest.raises(GeometryError, match="'view0' alone leaves the object's depth open"):
        carve(Views(views.views[:1]), 32)
    beside = replace(views[0], camera=replace(views[0].camera, name="beside"))
    with pytest.raises(GeometryError, match="look the same way"):
        carve(Views((views[0], beside)), 32)


def test_empty_and_absent_masks_are_ignored_with_a_note(masked_views, jug):
    views = masked_views(jug, count=6, size=96)
    made = carve(_without(views, 2), 32)
    assert "view2" in made.status
    assert "empty" in made.status
    absent = Views((replace(views[0], mask=None), *views.views[1:]))
    assert "has no mask" in carve(absent, 32).status


def test_no_mask_at_all_is_an_error(masked_views, jug):
    views = masked_views(jug, count=3, size=64)
    with pytest.raises(GeometryError, match="No view shows the object"):
        carve(_without(views, 0, 1, 2))
    broken = views[0].mask.copy()
    broken[3, 3] = np.nan
    with pytest.raises(GeometryError, match="view0"):
        carve(Views((replace(views[0], mask=broken), *views.views[1:])))
    full = Views(tuple(replace(v, mask=np.ones_like(v.mask)) for v in views))
    with pytest.raises(GeometryError, match="fills its whole image"):
        carve(full)


@pytest.mark.parametrize("shift", [40, 14])
def test_a_view_that_disagrees_is_dropped(masked_views, shift):
    views = masked_views(_ball(0.3), count=6, size=128)
    wrong = replace(views[3], mask=np.roll(views[3].mask, shift, axis=1))
    made = carve(Views((*views.views[:3], wrong, *views.views[4:])), 32)
    assert made.status.startswith("fallback: the views disagree, so view 'view3' was dropped")
    np.testing.assert_allclose(np.ptp(made.mesh.bounds, axis=0), 0.6, atol=0.08)


def test_two_views_that_contradict_each_other_are_an_error():
    def view(position, rows):
        camera = Camera.from_fov(0.8, look_along(position, -np.array(position)), 64, 64, f"at {position}")
        mask = np.zeros((64, 64), dtype=np.float32)
        mask[rows, 24:40] = 1
        return View(camera, np.zeros((64, 64, 3), np.uint8), None, mask)

    ahead, beside = view([2.0, 0, 0], slice(24, 40)), view([0, 2.0, 0], slice(26, 42))
    assert carve(Views((ahead, beside)), 32).status == "ok"
    with pytest.raises(GeometryError, match="contradict each other"):
        carve(Views((ahead, view([0, 2.0, 0], slice(50, 62)))), 32)


def test_a_mask_cut_by_the_image_does_not_cut_the_object(masked_views):
    ball = _ball(0.4)
    views = masked_views(ball, count=6, size=128)
    near = views[0].camera
    closer = Camera(
        near.K @ np.diag([1.0, 1.0, 1.0]) + np.array([[0, 0, 60.0], [0, 0, 0], [0, 0, 0]]),
        near.world_from_camera, near.width, near.height, "cut",
    )  # fmt: skip
    mask = np.zeros_like(views[0].mask)
    mask[:, 60:] = views[0].mask[:, :-60]
    assert mask[:, -1].any()
    made = carve(Views((View(closer, views[0].image, None, mask), *views.views[1:])), 48)
    assert made.status == "ok"
    assert np.ptp(made.mesh.bounds, axis=0).min() > 0.75


def test_what_the_robot_hides_is_no_evidence(masked_views):
    views = masked_views(_ball(0.4), count=5, size=128)
    arm = np.zeros(views[0].mask.shape, dtype=bool)
    arm[:, 64:] = True
    hidden = replace(views[0], mask=np.where(arm, 0, views[0].mask).astype(np.float32), robot_mask=arm)
    made = carve(Views((hidden, *views.views[1:])), 48)
    assert np.ptp(made.mesh.bounds, axis=0).min() > 0.75


def test_thin_objects_survive_a_coarse_grid(masked_views):
    rod = trimesh.creation.box((1.0, 0.02, 0.02))
    made = carve(masked_views(rod, count=6, size=256, seed=4), 32)
    assert np.ptp(made.mesh.bounds, axis=0)[0] > 0.95


def test_gaussians_cover_the_surface(masked_views, jug):
    from gvla2.reconstruction.rasteriser import Rasteriser

    views = masked_views(jug, count=6, size=128)
    made = carve(views, 64).to_reconstruction(6000)
    assert 5000 < len(made.gaussians) < 7000
    for view in views:
        image, alpha = Rasteriser().render(made.gaussians, view.camera)
        inside = view.mask > 0.5
        assert (alpha[inside] > 0.9).mean() > 0.98
        assert np.abs(image - view.image / 255.0)[inside].mean() < 0.06
        assert ((alpha > 0.5) & ~inside).sum() < 0.15 * inside.sum()
