import numpy as np
import pytest
from scipy.optimize import minimize

from gvla2.errors import GeometryError
from gvla2.reconstruction.appearance import fit_affine


@pytest.fixture
def image() -> np.ndarray:
    return np.random.default_rng(0).uniform(0.1, 0.8, (40, 50, 3))


def test_recovers_a_planted_affine_in_spite_of_outliers(image):
    gain, bias = np.array([1.1, 0.9, 1.05]), np.array([-0.03, 0.05, 0.02])
    seen = image * gain + bias
    spoilt = seen.copy()
    spoilt[:12] = 1.0  # a highlight over 30 % of the pixels
    fit = fit_affine(image, spoilt, np.ones((40, 50)), beta=0.0)
    np.testing.assert_allclose(fit.gain, gain, atol=1e-3)
    np.testing.assert_allclose(fit.bias, bias, atol=1e-3)
    assert fit.reason == ""
    np.testing.assert_allclose(np.clip(fit.gain * image + fit.bias, 0, 1), np.clip(seen, 0, 1), atol=2e-3)


@pytest.mark.parametrize("beta", [0.0, 0.01, 1.0])
def test_reaches_the_minimum_of_the_papers_objective(image, beta):
    rng = np.random.default_rng(1)
    seen = 0.8 * image + 0.1 + rng.laplace(0, 0.05, image.shape)
    mask = rng.uniform(0, 1, (40, 50)) * (rng.uniform(size=(40, 50)) > 0.4)
    fit = fit_affine(image, seen, mask, beta)
    for channel in range(3):
        x, y, w = image[mask > 0][:, channel], seen[mask > 0][:, channel], mask[mask > 0]

        def objective(p, x=x, y=y, w=w):
            residual = np.abs(p[0] * x + p[1] - y)
            return (w * residual).sum() / w.sum() + beta * (p[0] - 1) ** 2 + beta * p[1] ** 2

        best = minimize(objective, [1.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-13})
        assert objective([fit.gain[channel], fit.bias[channel]]) <= best.fun * (1 + 1e-5) + 1e-9


def test_degenerate_masks_give_the_identity_with_a_reason(image):
    fit = fit_affine(image, 0.5 * image, np.zeros((40, 50)))
    assert fit.gain.tolist() == [1, 1, 1]
    assert "0 masked pixels" in fit.reason
    broken = np.full_like(image, np.nan)
    assert "masked pixels" in fit_affine(broken, image, np.ones((40, 50))).reason


def test_a_constant_render_gets_a_bias_only(image):
    flat = np.full_like(image, 0.5)
    fit = fit_affine(flat, flat - 0.2, np.ones((40, 50)), beta=0.0)
    np.testing.assert_allclose(fit.gain, 1)
    np.testing.assert_allclose(fit.bias, -0.2, atol=1e-4)
    assert "constant" in fit.reason


def test_a_negative_does_not_turn_the_colours_round(image):
    fit = fit_affine(image, 1 - image, np.ones((40, 50)), beta=0.0)
    assert fit.gain.tolist() == [1, 1, 1]
    assert "not alike" in fit.reason


def test_errors(image):
    with pytest.raises(GeometryError, match="alike"):
        fit_affine(image, image[:10], np.ones((40, 50)))
    with pytest.raises(GeometryError, match="beta"):
        fit_affine(image, image, np.ones((40, 50)), beta=-1)
    with pytest.raises(GeometryError, match="3 channels"):
        fit_affine(image[..., 0], image[..., 0], np.ones((40, 50)))
