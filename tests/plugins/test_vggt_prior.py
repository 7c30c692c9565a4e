"""The VGGT prior on a tiny network of the same interface, randomly initialised."""

import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, MissingDependencyError, PluginError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import invert_rigid, rigid
from gvla2.geometry.views import View, Views
from gvla2.testing import inputs
from gvla2.testing.reconstruction import check_prior
from gvla2_plugins.vggt_prior import VggtPriorConfig, gvla2_geometry_priors
from gvla2_plugins.vggt_prior.prior import VggtPrior, decode_poses


class Tiny(torch.nn.Module):
    """What VGGT takes and returns, at random: images (B, S, 3, H, W) in [0, 1] in, patches of 14 pixels."""

    def __init__(self) -> None:
        super().__init__()
        self.patches = torch.nn.Conv2d(3, 8, 14, stride=14)
        self.camera = torch.nn.Linear(8, 9)
        self.head = torch.nn.Conv2d(8, 5, 1)
        self.seen: torch.Tensor | None = None

    def forward(self, images: torch.Tensor) -> dict[str, torch.Tensor]:
        assert images.min() >= 0
        assert images.max() <= 1
        self.seen = images
        batch, count, _, height, width = images.shape
        tokens = self.patches(images.flatten(0, 1))
        maps = torch.nn.functional.interpolate(self.head(tokens), (height, width), mode="bilinear")
        maps = maps.unflatten(0, (batch, count))
        return {
            "pose_enc": self.camera(tokens.mean(dim=(2, 3))).unflatten(0, (batch, count)),
            "depth": maps[:, :, 0, ..., None].exp(),
            "depth_conf": 1 + maps[:, :, 1].exp(),
            "world_points": maps[:, :, 2:].movedim(2, -1),
        }


@pytest.fixture
def module(monkeypatch):
    for name in ("vggt", "vggt.models", "vggt.models.vggt"):
        made = ModuleType(name)
        made.VGGT = Tiny
        monkeypatch.setitem(sys.modules, name, made)


def network() -> Tiny:
    torch.manual_seed(0)
    return Tiny()


def config(**options) -> VggtPriorConfig:
    return VggtPriorConfig(**{"width": 56, "device": "cpu", **options})


def build(**options):
    (component,) = gvla2_geometry_priors()
    return component.build(config(**options))


def test_it_keeps_the_contract():
    check_prior(VggtPrior(config(), network()))


def test_the_network_sees_the_objects_on_white_at_its_own_size():
    tiny = network()
    camera = Camera.from_fov(0.8, np.eye(4), 120, 80)
    mask = np.zeros((80, 120), np.float32)
    mask[20:60, 30:90] = 1
    view = View(camera, np.full((80, 120, 3), 51, np.uint8), mask=mask)
    found = VggtPrior(config(width=112), tiny).predict(Views((view, replace(view, mask=None))))
    assert tiny.seen.shape == (1, 2, 3, 70, 112)  # 112 * 80 / 120, to the nearest multiple of 14
    assert tiny.seen[0, 0, :, 0, 0].tolist() == [1, 1, 1]
    assert tiny.seen[0, 0, 0, 35, 56].item() == pytest.approx(0.2)
    assert tiny.seen[0, 1].max().item() == pytest.approx(0.2)
    assert found.depth.shape == found.confidence.shape == (2, 80, 120)


def test_pose_encoding_is_translation_quaternion_and_fields_of_view():
    rng = np.random.default_rng(0)
    turns = Rotation.random(4, random_state=1)
    shifts, fields = rng.normal(size=(4, 3)), rng.uniform(0.3, 1.5, (4, 2))
    length = rng.uniform(0.5, 3, (4, 1))
    poses = decode_poses(np.hstack([shifts, length * turns.as_quat(), fields]))
    for pose, turn, shift in zip(poses, turns, shifts, strict=True):
        np.testing.assert_allclose(invert_rigid(pose), rigid(turn.as_matrix(), shift), atol=1e-9)


@pytest.mark.parametrize(("wrapped", "as_folder"), [(False, True), (True, False)])
def test_weights_come_from_a_local_file(module, tmp_path, wrapped, as_folder):
    tiny, views = network(), inputs.views(masked=inputs.RED)
    state = tiny.state_dict() | {"track_head.extra": torch.zeros(3)}
    torch.save({"model": state} if wrapped else state, tmp_path / "model.pt")
    found = build(weights=str(tmp_path if as_folder else tmp_path / "model.pt")).predict(views)
    np.testing.assert_array_equal(found.depth, VggtPrior(config(), tiny).predict(views).depth)


def test_absent_weights_name_source_and_licence(module, tmp_path):
    for weights in ("", str(tmp_path), str(tmp_path / "model.pt")):
        with pytest.raises(
            MissingDependencyError, match=r"facebook/VGGT-1B.*CC-BY-NC-4.0, no commercial use"
        ):
            build(weights=weights)


def test_weights_that_do_not_fit_are_refused(module, tmp_path):
    path = tmp_path / "model.pt"
    state = network().state_dict()
    torch.save({k: v for k, v in state.items() if k != "camera.bias"}, path)
    with pytest.raises(ConfigurationError, match=r"lacks 1 of the network's weights \(camera.bias"):
        build(weights=str(path))
    torch.save(state | {"camera.bias": torch.zeros(3)}, path)
    with pytest.raises(ConfigurationError, match="Cannot read VGGT's weights"):
        build(weights=str(path))
    torch.save(torch.zeros(3), path)
    with pytest.raises(ConfigurationError, match="Cannot read VGGT's weights"):
        build(weights=str(path))
    path.write_bytes(b"cut off")
    with pytest.raises(ConfigurationError, match="Cannot read VGGT's weights"):
        build(weights=str(path))


def test_the_absent_package_is_named_with_its_licence(monkeypatch):
    monkeypatch.setitem(sys.modules, "vggt", None)
    (component,) = gvla2_geometry_priors()
    with pytest.raises(MissingDependencyError, match=r"package 'vggt'.*facebookresearch/vggt.*licence"):
        component.build(VggtPriorConfig(device="cpu", weights="model.pt"))


def test_a_width_that_is_no_multiple_of_the_patches_is_refused():
    with pytest.raises(ConfigurationError, match="multiple of 14"):
        VggtPrior(config(width=500), network())


def test_a_network_of_another_interface_is_refused():
    class Other(torch.nn.Module):
        def __init__(self, answer) -> None:
            super().__init__()
            self.answer = answer

        def forward(self, images: torch.Tensor):
            return self.answer

    views = inputs.views(masked=inputs.RED)
    good = {
        "pose_enc": torch.ones(1, 3, 9),
        "depth": torch.ones(1, 3, 8, 8),
        "depth_conf": torch.ones(1, 3, 8, 8),
    }
    VggtPrior(config(), Other(good)).predict(views)
    for answer, words in (
        (torch.zeros(1), "no pose_enc, depth, depth_conf"),
        ({"depth": torch.ones(1, 3, 8, 8)}, "no pose_enc, depth_conf"),
        (good | {"pose_enc": torch.ones(1, 2, 9)}, "pose_enc has shape"),
        (good | {"depth": torch.ones(3, 8, 8)}, "depth has shape"),
    ):
        with pytest.raises(PluginError, match=words):
            VggtPrior(config(), Other(answer)).predict(views)
