import numpy as np
import pytest

from gvla2.evaluation.drift import DRIFTS, Drift, DriftSize
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.reconstruction.contracts import Reconstruction


def cloud(count: int = 40) -> Reconstruction:
    rng = np.random.default_rng(0)
    centres = rng.uniform(-0.5, 0.5, (count, 3))
    gaussians = Gaussians(
        centres,
        rng.normal(-4, 0.1, (count, 3)),
        rng.normal(size=(count, 4)),
        rng.normal(size=count),
        rng.normal(size=(count, 3)),
    )
    faces = np.arange(count - count % 3).reshape(-1, 3)
    return Reconstruction(gaussians, TriangleMesh(centres, faces))


@pytest.mark.parametrize("name", [name for name, size in DRIFTS.items() if size])
def test_a_drift_is_known_repeatable_and_within_its_bounds(name):
    size = DRIFTS[name]
    one, again = (Drift.drawn(size, "mug", 3) for _ in range(2))
    np.testing.assert_array_equal(one.scale, again.scale)
    np.testing.assert_array_equal(one.shift, again.shift)
    assert not np.allclose(one.shift, Drift.drawn(size, "mug", 4).shift)
    assert not np.allclose(one.shift, Drift.drawn(size, "bowl", 3).shift)
    assert np.abs(one.shift).max() <= size.shift
    assert np.abs(np.log(one.scale)).max() <= np.log((1 + size.axes) * (1 + size.scale)) + 0.01
    turn = np.degrees(np.arccos(np.clip((np.trace(one.rotation) - 1) / 2, -1, 1)))
    assert turn <= size.degrees + 1e-6


def test_gaussians_and_mesh_move_together():
    thing = cloud()
    moved = Drift.drawn(DRIFTS["planted"], "mug", 0).applied(thing)
    np.testing.assert_allclose(moved.gaussians.centres, moved.mesh.vertices, atol=1e-6)
    assert np.linalg.norm(moved.mesh.vertices - thing.mesh.vertices, axis=1).mean() > 1e-3
    np.testing.assert_array_equal(moved.gaussians.sh_dc, thing.gaussians.sh_dc)


def test_a_turn_turns_the_gaussians_themselves():
    thing = cloud()
    drift = Drift.drawn(DriftSize(degrees=30), "mug", 1)
    moved = drift.applied(thing)
    expected = drift.rotation @ thing.gaussians.covariances() @ drift.rotation.T
    np.testing.assert_allclose(moved.gaussians.covariances(), expected, rtol=1e-3, atol=1e-8)


def test_nothing_to_drift():
    nothing = Reconstruction(None, None)
    assert Drift.drawn(DRIFTS["planted"], "mug", 0).applied(nothing) is nothing
