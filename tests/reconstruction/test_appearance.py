from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.optimize import minimize

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.views import Views
from gvla2.reconstruction.appearance import fit_affine, vertex_colours
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.silhouette import depth_map, mask_silhouettes


@pytest.fixture
def image() -> np.ndarray:
    return np.random.default_rng(0).uniform(0.1, 0.8, (40, 50, 3))


def test_recovers_a_planted_affine_in_spite_of_outliers(image):
    gain, bias = np.array([1.1, 0.9, 1.05]), np.array([-0.03, 0.05, 0.02])
    seen = image * gain + bias
    spoilt = seen.copy()
    spoilt[:12] = 1.0  # a highlight over 30 % of the pixels
    fitted = fit_affine(image, spoilt, np.ones((40, 50)), beta=0.0)
    np.testing.assert_allclose(fitted, [gain, bias], atol=1e-3)


@pytest.mark.parametrize("beta", [0.0, 0.01, 1.0])
def test_reaches_the_minimum_of_the_papers_objective(image, beta):
    rng = np.random.default_rng(1)
    seen = 0.8 * image + 0.1 + rng.laplace(0, 0.05, image.shape)
    mask = rng.uniform(0, 1, (40, 50)) * (rng.uniform(size=(40, 50)) > 0.4)
    gain, bias = fit_affine(image, seen, mask, beta)
    for channel in range(3):
        x, y, w = image[mask > 0][:, channel], seen[mask > 0][:, channel], mask[mask > 0]

        def objective(p, x=x, y=y, w=w):
            residual = np.abs(p[0] * x + p[1] - y)
            return (w * residual).sum() / w.sum() + beta * (p[0] - 1) ** 2 + beta * p[1] ** 2

        best = minimize(objective, [1.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-13})
        assert objective([gain[channel], bias[channel]]) <= best.fun * (1 + 1e-5) + 1e-9


def test_too_few_pixels_and_a_negative_give_no_affine(image):
    assert fit_affine(image, 0.5 * image, np.zeros((40, 50))) is None
    assert fit_affine(np.full_like(image, np.nan), image, np.ones((40, 50))) is None
    assert fit_affine(image, 1 - image, np.ones((40, 50)), beta=0.0) is None


RED, GREEN = np.array([0.9, 0.1, 0.1]), np.array([0.1, 0.8, 0.1])


def _painted(masked_views, mesh, count, size=128, seed=0):
    """Views with each pixel in the colour of its place: red where x > 0, green elsewhere, without shading."""
    painted = []
    for view in masked_views(mesh, count=count, size=size, seed=seed):
        x = np.nan_to_num(view.points()[..., 0])
        image = np.where(x[..., None] > 0, RED, GREEN)
        image = np.where(view.mask[..., None] > 0.5, image, 1.0)
        painted.append(replace(view, image=np.rint(255 * image).astype(np.uint8)))
    return Views(tuple(painted))


def test_colours_come_from_the_views(masked_views):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    made = carve(_painted(masked_views, ball, 12), 48)
    x, colours = made.mesh.vertices[:, 0], made.mesh.colours
    assert made.seen.mean() > 0.9
    assert np.abs(colours[x > 0.08] - RED).max(axis=1).mean() < 0.03
    assert np.abs(colours[x < -0.08] - GREEN).max(axis=1).mean() < 0.03
    # Silhouettes are mixed with the white around them; none of it may end on the object.
    assert colours.min(axis=1).max() < 0.5


def test_what_stands_in_front_gives_no_colour_to_what_is_behind(masked_views):
    # A big red ball behind a small green one, seen from ahead only.
    back = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    back.apply_translation([0.25, 0, 0])
    front = trimesh.creation.icosphere(subdivisions=3, radius=0.12)
    front.apply_translation([-0.3, 0, 0])
    whole = trimesh.util.concatenate([back, front])
    views = _painted(masked_views, whole, 14, seed=3)
    mesh = TriangleMesh(whole.vertices, whole.faces)
    shown, _ = mask_silhouettes(views)
    depths = [depth_map(mesh, s.camera) for s in shown]
    colours, seen = vertex_colours(mesh, np.array(whole.vertex_normals), shown, depths, 0.02)
    behind = (mesh.vertices[:, 0] > 0.05) & seen
    wrong = np.abs(colours[behind] - RED).max(axis=1) > 0.1
    assert wrong.mean() < 0.005


def test_one_liar_among_the_views_is_outvoted(masked_views):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    views = list(masked_views(ball, count=14, size=96))
    plain = [
        replace(v, image=np.repeat(np.where(v.mask > 0.5, 128, 255)[..., None], 3, -1).astype(np.uint8))
        for v in views
    ]
    black = replace(plain[0], image=np.zeros((96, 96, 3), dtype=np.uint8))
    shown, _ = mask_silhouettes(Views((black, *plain[1:])))
    mesh = TriangleMesh(ball.vertices, ball.faces)
    depths = [depth_map(mesh, s.camera) for s in shown]
    colours, seen = vertex_colours(mesh, np.array(ball.vertex_normals), shown, depths, 0.02)
    assert np.quantile(np.abs(colours[seen] - 128 / 255).max(axis=1), 0.95) < 0.05


def test_the_unseen_take_their_neighbours_colour(masked_views):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    made = carve(_painted(masked_views, ball, 2, seed=5), 32)
    assert not made.seen.all()
    hidden = made.mesh.colours[~made.seen]
    # Of two colours in the views, any mean of them may come, and nothing else.
    assert (hidden[:, 2] < 0.15).mean() > 0.98
    on_the_line = np.abs(hidden[:, 0] / 0.8 + hidden[:, 1] / 0.7 - 0.9 / 0.8 - 0.1 / 0.7) < 0.15
    assert on_the_line.mean() > 0.98
