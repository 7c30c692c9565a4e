from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
import torch

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.testing.reconstruction import check_renderer
from gvla2_plugins.gsplat_renderer import GsplatRendererConfig, gvla2_renderers
from gvla2_plugins.gsplat_renderer.renderer import arguments

USABLE = torch.cuda.is_available() and importlib.util.find_spec("gsplat") is not None


def build(**options: object):
    [component] = gvla2_renderers()
    assert component.name == "gsplat"
    return component.build(GsplatRendererConfig(name="gsplat", **options))


@pytest.mark.skipif(not USABLE, reason="needs the package gsplat and a CUDA device")
def test_conformance() -> None:
    check_renderer(build())


@pytest.mark.skipif(USABLE, reason="everything is there")
def test_what_is_missing_is_named() -> None:
    with pytest.raises(MissingDependencyError, match=r"renderer=gsplat needs .*pip install gsplat") as caught:
        build()
    assert "Apache-2.0" in str(caught.value)


def test_a_missing_torch_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingDependencyError, match=r"pip install torch gsplat"):
        build()


@pytest.mark.parametrize("options", [{"device": "cpu"}, {"near": 0.0}, {"low_pass": -0.1}])
def test_senseless_options_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError, match="renderer=gsplat"):
        build(**options)


def test_arguments_are_in_gsplat_s_layout() -> None:
    rng = np.random.default_rng(0)
    scene = Gaussians(
        rng.normal(size=(4, 3)), [[0.0, -1, -np.inf]] * 4, rng.normal(size=(4, 4)), [np.inf, -np.inf, 0, 1],
        rng.normal(size=(4, 3)), rng.normal(size=(4, 24)),
    )  # fmt: skip
    pose = np.eye(4)
    pose[:3, 3] = [1, 2, 3]
    camera = Camera(np.array([[50.0, 0, 20], [0, 60, 10], [0, 0, 1]]), pose, 40, 20)
    config = GsplatRendererConfig(name="gsplat", device="cpu", near=0.2, low_pass=0.1)
    made = arguments(torch, scene, camera, (0.1, 0.2, 0.3), config)
    assert made["means"].shape == (4, 3)
    assert made["sh_degree"] == 2
    assert made["colors"].shape == (4, 9, 3)
    assert np.allclose(made["colors"][:, 0], scene.sh_dc)
    assert np.allclose(made["colors"][:, 1:, 1], scene.sh_rest[:, 8:16])  # green's coefficients come second
    assert np.allclose(made["scales"][0, :2], [1, np.exp(-1)])
    assert np.allclose(made["opacities"], [1, 0, 0.5, 1 / (1 + np.exp(-1))])
    assert np.allclose(made["viewmats"][0, :3, 3], [-1, -2, -3])
    assert np.allclose(made["Ks"][0], camera.K)
    assert (made["width"], made["height"], made["near_plane"], made["eps2d"]) == (40, 20, 0.2, 0.1)
    assert all(torch.isfinite(value).all() for value in made.values() if isinstance(value, torch.Tensor))
