from __future__ import annotations

import numpy as np
import pytest

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import Gaussians


def random_gaussians(n: int, seed: int, rest: int | None = None) -> Gaussians:
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.normal(size=shape).astype(np.float32)  # noqa: E731
    return Gaussians(
        draw(n, 3), draw(n, 3), draw(n, 4), draw(n), draw(n, 3), None if rest is None else draw(n, rest)
    )


def test_colour_opacity_and_scale_are_decoded() -> None:
    gaussians = Gaussians(
        np.zeros((3, 3)),
        np.log([[1, 2, 3]] * 3),
        [[1, 0, 0, 0]] * 3,
        [0, np.inf, -np.inf],
        [[0, 1, -1]] * 3,
    )
    assert np.allclose(gaussians.rgb[0], [0.5, 0.7820948, 0.2179052])
    assert gaussians.opacities.tolist() == [0.5, 1.0, 0.0]
    assert np.allclose(gaussians.scales, [[1, 2, 3]])
    assert len(gaussians) == 3


def test_with_centres_changes_xyz_alone() -> None:
    gaussians = random_gaussians(5, 0, rest=9)
    moved = gaussians.with_centres(gaussians.centres + 1)
    assert np.array_equal(moved.centres, gaussians.centres + 1)
    for name in ("log_scales", "rotations", "opacity_logits", "sh_dc", "sh_rest"):
        assert getattr(moved, name) is getattr(gaussians, name)
    with pytest.raises(GeometryError, match="5 Gaussians"):
        gaussians.with_centres(np.zeros((4, 3)))
    with pytest.raises(GeometryError, match="not finite"):
        gaussians.with_centres(np.full((5, 3), np.nan))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("centres", np.zeros((2, 2)), "centres"),
        ("centres", np.array([[0, 0, np.inf], [0, 0, 0]]), "1 of 2 centres"),
        ("log_scales", np.zeros((3, 3)), "log_scales"),
        ("log_scales", np.full((2, 3), np.inf), "infinite"),
        ("rotations", np.zeros((2, 4)), "length zero"),
        ("opacity_logits", np.array([0, np.nan]), "opacity_logits contains NaN"),
        ("sh_dc", np.zeros((2, 4)), "sh_dc"),
        ("sh_rest", np.zeros((2, 10)), "columns"),
        ("sh_rest", np.zeros((1, 9)), "sh_rest"),
    ],
)
def test_malformed_arrays_are_refused(name: str, value: np.ndarray, words: str) -> None:
    good = {
        "centres": np.zeros((2, 3)),
        "log_scales": np.zeros((2, 3)),
        "rotations": np.ones((2, 4)),
        "opacity_logits": np.zeros(2),
        "sh_dc": np.zeros((2, 3)),
    }
    with pytest.raises(GeometryError, match=words):
        Gaussians(**{**good, name: value})
