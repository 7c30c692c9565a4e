from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import GeometryError
from gvla2.geometry.views import Views
from gvla2.reconstruction.branch import BranchComponents, refine_geometry
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import AxisFit, GeometryEstimate, Reconstruction
from gvla2.reconstruction.options import BranchOptions
from gvla2.reconstruction.rasteriser import Rasteriser
from gvla2.reconstruction.support import object_centre
from gvla2.reconstruction.view_set import points_of
from gvla2_plugins.axes import ContoursConfig
from gvla2_plugins.axes.compensations import Contours, MaskEnergy
from gvla2_plugins.geofuse.fusions import Residual
from gvla2_plugins.nothing import NoPrior

SCALE, SHIFT = np.array([1.06, 0.95, 1.04]), np.array([0.02, -0.015, 0.01])


class Depth:
    """The views' own depth as a prior."""

    def predict(self, views):
        depth = np.stack([v.depth for v in views])
        return GeometryEstimate(depth, np.isfinite(depth).astype(np.float32))


class Wrong:
    """A prior for another number of views."""

    def predict(self, views):
        return GeometryEstimate(np.ones((1, 4, 4), np.float32), np.ones((1, 4, 4), np.float32))


@pytest.fixture(scope="module")
def views(masked_views, jug):
    return masked_views(jug, size=96)


@pytest.fixture(scope="module")
def g0(views):
    return carve(views, resolution=48).to_reconstruction(6_000)


def drifted(obj: Reconstruction) -> Reconstruction:
    c = object_centre(points_of(obj))
    gaussians = obj.gaussians.with_centres(c + (obj.gaussians.centres - c) * SCALE + SHIFT)
    return replace(
        obj,
        gaussians=gaussians,
        mesh=obj.mesh.with_vertices(c + (obj.mesh.vertices - c) * SCALE + SHIFT),
    )


def refine(obj, views, given=None, **options):
    axis = MaskEnergy(10) if options.get("mode") == "paper" else Contours(ContoursConfig(name="contours"))
    parts = BranchComponents(given or NoPrior(), axis, Residual(0.5), Rasteriser())
    if options.get("mode") == "paper":
        options = {"soft_hull": True, "fusion": True, **options}
    return refine_geometry(obj, views, parts, BranchOptions(**options))


def status(result):
    return {stage.stage: stage.status for stage in result.stages}


def test_a_drift_of_the_whole_object_is_undone_and_gaussians_and_mesh_move_together(g0, views):
    start = drifted(g0)
    out = refine(start, views).out
    before = np.linalg.norm(start.mesh.vertices - g0.mesh.vertices, axis=1).mean()
    after = np.linalg.norm(out.mesh.vertices - g0.mesh.vertices, axis=1).mean()
    assert after < 0.3 * before
    moved = out.gaussians.centres - start.gaussians.centres
    mesh = out.mesh.vertices - start.mesh.vertices
    np.testing.assert_allclose(moved.mean(axis=0), mesh.mean(axis=0), atol=6e-3)


def test_without_a_prior_only_positions_change(g0, views):
    start = drifted(g0)
    out = refine(start, views, appearance=False).out
    for name in ("log_scales", "rotations", "opacity_logits", "sh_dc"):
        np.testing.assert_array_equal(getattr(out.gaussians, name), getattr(start.gaussians, name))
    np.testing.assert_array_equal(out.mesh.faces, start.mesh.faces)
    np.testing.assert_array_equal(out.mesh.colours, start.mesh.colours)


def test_a_prior_for_other_views_is_a_typed_fallback(g0, views):
    result = refine(g0, views, Wrong(), axis=False, fusion=False)
    assert status(result)["prior"] in ("fallback", "rejected")
    np.testing.assert_array_equal(result.a.gaussians.sh_dc, g0.gaussians.sh_dc)


def test_sources_of_other_topology_fall_back_to_a(g0, views):
    class Growing:
        def fuse(self, a, b, support_a, support_b):
            return np.concatenate([a, b])

    parts = BranchComponents(NoPrior(), Contours(ContoursConfig(name="contours")), Growing(), Rasteriser())
    result = refine_geometry(
        drifted(g0), views, parts, BranchOptions(appearance=False, fusion=True, mode="paper")
    )
    assert status(result)["fusion"] == "fallback"
    np.testing.assert_array_equal(result.out.gaussians.centres, result.a.gaussians.centres)


def test_paper_mode_puts_both_sources_beside_each_other(g0, views):
    start = drifted(g0)
    result = refine(start, views, mode="paper")
    assert [s.stage for s in result.stages] == ["prior", "appearance", "soft_hull", "axis", "fusion"]
    # alpha is one half: the fused geometry lies between the sources, nowhere beyond.
    a, b, out = (np.asarray(r.gaussians.centres, dtype=np.float64) for r in (result.a, result.b, result.out))
    assert (np.linalg.norm(out - a, axis=1) <= 0.5 * np.linalg.norm(b - a, axis=1) + 1e-5).all()


def test_soft_hull_and_fusion_are_off_unless_asked_for(g0, views):
    usual, whole = refine(g0, views, Depth()), refine(g0, views, Depth(), soft_hull=True, fusion=True)
    assert not {"soft_hull", "axis"} & set(status(usual))
    assert status(usual)["fusion"] == "skipped"
    assert {"soft_hull", "axis", "fusion"} <= set(status(whole))


def test_a_row_has_its_stages_and_no_others():
    assert BranchOptions().row("ab_fusion") == BranchOptions(soft_hull=True, fusion=True)
    assert BranchOptions(axis=False).row("b_axis") == BranchOptions(prior=False, appearance=False, axis=False)
    assert BranchOptions(soft_hull=True).row("a_prior_appearance") == BranchOptions(axis=False)


def test_the_masks_may_refuse_all_of_it(g0, views):
    class Swelling:
        def compensate(self, points, views, centre):
            return AxisFit(np.full(3, 1.01), np.zeros(3), True, 0.9, 0.9, 1, "as asked", centre)

    class Bulging:
        def fuse(self, a, b, support_a, support_b):
            return a * 1.5

    parts = BranchComponents(NoPrior(), Swelling(), Bulging(), Rasteriser())
    result = refine_geometry(g0, views, parts, BranchOptions(fusion=True))
    assert status(result)["fusion"] == "rejected"
    np.testing.assert_allclose(result.out.mesh.vertices, result.a.mesh.vertices)


def test_views_without_masks_and_empty_reconstructions_are_refused(g0, views):
    with pytest.raises(GeometryError, match="mask"):
        refine(g0, Views(tuple(replace(v, mask=None) for v in views)))
    with pytest.raises(GeometryError, match="empty"):
        refine(Reconstruction(None, None), views)


def test_names_that_stand_twice_are_refused(g0, views):
    first = replace(views[1], camera=replace(views[1].camera, name=views[0].name))
    with pytest.raises(GeometryError, match="stands twice"):
        refine(g0, Views((views[0], first, *views.views[2:])))


def test_a_prior_makes_a_new_surface_and_takes_the_gaussians_along(g0, views):
    result = refine(g0, views, Depth())
    assert status(result)["prior"] == "applied"
    assert abs(len(result.out.gaussians) / len(g0.gaussians) - 1) < 0.15
    assert set(np.unique(result.out.gaussians.opacity_logits)) <= set(np.unique(g0.gaussians.opacity_logits))
    assert len(result.out.mesh.faces) != len(g0.mesh.faces)
