from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry import compiled
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.geometry.transform import look_along
from gvla2.reconstruction import rasteriser as rasteriser_module
from gvla2.reconstruction.rasteriser import Rasteriser

CAMERA = Camera.from_fov(0.7, look_along([0.2, -1.5, 0.4], [-0.2, 1.5, -0.4]), 37, 32)
SKEWED = Camera(
    np.array([[52.0, 1.5, 11.0], [0, 47.0, 20.0], [0, 0, 1]]), CAMERA.world_from_camera, 32, 37, "skewed"
)
FIELDS = ("centres", "log_scales", "rotations", "opacity_logits", "sh_dc")


def cloud(count: int, seed: int = 0, spread: float = 0.3, size: float = 0.06) -> Gaussians:
    rng = np.random.default_rng(seed)
    return Gaussians(
        rng.normal(scale=spread, size=(count, 3)),
        np.log(rng.uniform(0.2, 1.2, (count, 3)) * size),
        rng.normal(size=(count, 4)),
        rng.uniform(-2.0, 2.5, count),
        rng.normal(scale=1.2, size=(count, 3)),
    )


def torch_render(
    scene: Gaussians,
    camera: Camera,
    background: tuple[float, float, float],
    rasteriser: Rasteriser,
) -> tuple[torch.Tensor, torch.Tensor]:
    """3D Gaussian splatting in a few dense lines of float64: every Gaussian at every pixel, no tiles, no stop."""
    parameters = {name: torch.tensor(getattr(scene, name)).double() for name in FIELDS}
    pose, K = torch.tensor(camera.camera_from_world), torch.tensor(camera.K)
    local = parameters["centres"] @ pose[:3, :3].T + pose[:3, 3]
    order = torch.argsort(local[:, 2], stable=True)
    order = order[local[order, 2] > rasteriser.near]
    local = local[order]
    x, y, z = local.T
    q = torch.nn.functional.normalize(parameters["rotations"][order], dim=1)
    w, i, j, k = q.T
    turn = torch.stack(
        [
            torch.stack([1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)]),
            torch.stack([2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)]),
            torch.stack([2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)]),
        ]
    ).permute(2, 0, 1)
    axes = turn * torch.exp(parameters["log_scales"][order])[:, None]
    corners = torch.tensor(
        [[0.0, 0, 1], [camera.width, 0, 1], [0, camera.height, 1], [camera.width, camera.height, 1]]
    )
    slopes = corners.double() @ torch.linalg.inv(K).T
    low, high = slopes.min(dim=0).values, slopes.max(dim=0).values
    low, high = low - 0.15 * (high - low), high + 0.15 * (high - low)
    sx, sy = (x / z).clamp(low[0], high[0]), (y / z).clamp(low[1], high[1])
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [torch.stack([1 / z, zero, -sx / z]), torch.stack([zero, 1 / z, -sy / z])]
    ).permute(2, 0, 1)
    image_axes = K[:2, :2] @ jacobian @ pose[:3, :3] @ axes
    covariance = image_axes @ image_axes.transpose(1, 2) + rasteriser.low_pass * torch.eye(2)
    uv = (local @ K.T)[:, :2] / z[:, None]
    offset = torch.tensor(camera.pixel_centres())[:, :, None] - uv
    power = -0.5 * torch.einsum("hwni,nij,hwnj->hwn", offset, torch.linalg.inv(covariance), offset)
    alpha = torch.sigmoid(parameters["opacity_logits"][order]) * torch.exp(power)
    alpha = torch.where(alpha >= rasteriser.min_alpha, alpha.clamp(max=0.99), torch.zeros_like(alpha))
    passing = torch.cumprod(torch.cat([torch.ones_like(alpha[..., :1]), 1 - alpha], dim=-1), dim=-1)
    colour = (0.5 + SH_C0 * parameters["sh_dc"][order]).clamp(min=0)
    image = (passing[..., :-1] * alpha) @ colour + passing[..., -1:] * torch.tensor(background).double()
    return image, 1 - passing[..., -1]


def agree(scene: Gaussians, camera: Camera, background, rasteriser: Rasteriser) -> None:
    image, alpha = rasteriser.render(scene, camera, background)
    wanted, wanted_alpha = torch_render(scene, camera, background, rasteriser)
    # 1e-4 of the light is the stop's, the rest rounding.
    assert np.abs(image - wanted.clamp(0, 1).numpy()).max() < 4e-4
    assert np.abs(alpha - wanted_alpha.numpy()).max() < 2e-4


@pytest.mark.parametrize(
    ("camera", "background", "seed"),
    [(CAMERA, (1.0, 1.0, 1.0), 0), (CAMERA, (0.1, 0.4, 0.8), 1), (SKEWED, (0.1, 0.4, 0.8), 0)],
)
def test_saturated_black_oblique_and_hidden_gaussians_agree_with_the_dense_reference(
    camera, background, seed
) -> None:
    # min_alpha so small that no pixel sits on its edge, where one side counts it and the other does not.
    rasteriser, scene = Rasteriser(min_alpha=1e-5), cloud(50, seed)
    logits, dark = scene.opacity_logits.copy(), scene.sh_dc.copy()
    centres, scales = scene.centres.copy(), scene.log_scales.copy()
    logits[:5] = 7.0  # alpha above 0.99 in the middle: clamped there
    dark[5:10] = -3.0  # black
    centres[10] = camera.position + np.array([0.5, 0.4, 0])  # seen at a flat angle, beyond the margin
    scales[10] = np.log(0.25)
    centres[11] = camera.position - 0.5 * camera.world_from_camera[:3, 2]  # behind
    agree(Gaussians(centres, scales, scene.rotations, logits, dark), camera, background, rasteriser)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 60))
def test_any_image_size_agrees_with_the_dense_reference(seed: int, width: int, height: int) -> None:
    camera = Camera.from_fov(0.7, CAMERA.world_from_camera, width, height)
    scene, rasteriser = cloud(25, seed), Rasteriser(min_alpha=1e-5)
    agree(scene, camera, (0.3, 0.2, 0.9), rasteriser)


def test_a_long_thin_gaussian_keeps_its_shape() -> None:
    """A needle across the image, 3000 times longer than wide: nothing may be lost to cancellation."""
    turn = Rotation.from_euler("z", 37, degrees=True).as_quat()[None, [3, 0, 1, 2]]
    scene = Gaussians(np.zeros((1, 3)), np.log([[3.0, 0.001, 0.001]]), turn, [4.0], np.zeros((1, 3)))
    camera = Camera.from_fov(0.7, look_along([0, 0, -1.5], [0, 0, 1.0]), 200, 200)
    rasteriser = Rasteriser(min_alpha=1e-4)
    _, alpha = rasteriser.render(scene, camera)
    _, wanted = torch_render(scene, camera, (1, 1, 1), rasteriser)
    assert wanted.max() > 0.9
    assert np.abs(alpha - wanted.numpy()).max() < 2e-3


@pytest.mark.parametrize("count", [10, 6000])
def test_threads_change_no_bit(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = cloud(count, 5, size=0.02)
    frames = []
    for threads in (1, 2, 3):
        for module in (compiled, rasteriser_module):
            monkeypatch.setattr(module, "cores", lambda threads=threads: threads)
        frames.append(Rasteriser().render(scene, CAMERA))
    for frame in frames[1:]:
        assert np.array_equal(frame[0], frames[0][0])
        assert np.array_equal(frame[1], frames[0][1])


def test_extreme_but_legal_parameters_stay_finite() -> None:
    scene = cloud(8)
    scales, logits = scene.log_scales.copy(), scene.opacity_logits.copy()
    scales[0], scales[1], scales[2] = 80.0, -np.inf, [5.0, -np.inf, -30.0]
    logits[3], logits[4], logits[5] = np.inf, -np.inf, 200.0
    scene = Gaussians(scene.centres, scales, scene.rotations * 1e-6, logits, scene.sh_dc)
    for rasteriser in (Rasteriser(), Rasteriser(low_pass=0.0)):
        image, alpha = rasteriser.render(scene, CAMERA)
        assert np.isfinite(image).all()
        assert alpha.min() >= 0
        assert alpha.max() <= 1


@pytest.mark.parametrize("options", [{"min_alpha": 0.0}, {"near": 0.0}, {"low_pass": -1.0}])
def test_options_out_of_range_are_refused(options) -> None:
    with pytest.raises(ConfigurationError, match="rasteriser needs"):
        Rasteriser(**options)
