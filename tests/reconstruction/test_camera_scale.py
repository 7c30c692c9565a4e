import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.transform import rigid
from gvla2.reconstruction.depth_evidence import scale_between
from tests.similarities import moved_poses, scale_of, similarity

seeds = st.integers(0, 2**32 - 1)


def random_similarity(rng: np.random.Generator) -> np.ndarray:
    rotation = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return similarity(float(np.exp(rng.uniform(-2, 2))), rotation, rng.normal(size=3) * 3)


def random_poses(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.stack(
        [
            rigid(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), rng.normal(size=3))
            for _ in range(count)
        ]
    )


@given(seeds, st.integers(2, 6))
@settings(max_examples=25, deadline=None)
def test_the_scale_between_cameras_is_found_exactly(seed, count):
    rng = np.random.default_rng(seed)
    truth, poses = random_similarity(rng), random_poses(rng, count)
    assert scale_between(poses, moved_poses(truth, poses)) == pytest.approx(scale_of(truth), rel=1e-6)


@pytest.mark.parametrize("count", [1, 3])
def test_without_a_baseline_the_scale_stays_open(count):
    rng = np.random.default_rng(4)
    truth, poses = random_similarity(rng), random_poses(rng, count)
    poses[:, :3, 3] = [10.0, 20.0, 30.0]
    assert scale_between(poses, moved_poses(truth, poses)) is None


@pytest.mark.parametrize(
    ("estimated", "calibrated", "words"),
    [
        (np.tile(np.eye(4), (2, 1, 1)), np.tile(np.eye(4), (3, 1, 1)), r"\(S, 4, 4\)"),
        (np.zeros((0, 4, 4)), np.zeros((0, 4, 4)), "S >= 1"),
        (np.diag([1.0, 1, -1, 1])[None], np.eye(4)[None], "mirrored"),
        (np.full((1, 4, 4), np.nan), np.eye(4)[None], "finite"),
    ],
)
def test_bad_cameras_are_named(estimated, calibrated, words):
    with pytest.raises(GeometryError, match=words):
        scale_between(estimated, calibrated)
