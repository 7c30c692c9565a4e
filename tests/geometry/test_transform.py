from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.transform import check_rigid, invert_rigid, look_along, rigid, transform_points


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_inverse_undoes_a_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = rigid(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
    points = rng.normal(size=(2, 5, 3))
    assert np.allclose(transform_points(invert_rigid(pose), transform_points(pose, points)), points)
    assert np.allclose(invert_rigid(pose) @ pose, np.eye(4))


def test_the_error_names_what_is_wrong_and_how_to_mend_a_mirror() -> None:
    with pytest.raises(GeometryError, match=r"hand pose is mirrored.*diag\(1, -1, -1\)"):
        check_rigid(np.diag([1.0, -1, 1, 1]), what="hand pose")


@pytest.mark.parametrize("position", [(0.0, 0.0, 2.0), (0.0, 0.0, -2.0), (1.0, 0.0, 0.0)])
def test_looking_along_is_a_rigid_motion_even_at_the_poles(position: tuple[float, float, float]) -> None:
    pose = look_along(position, -np.array(position))
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
