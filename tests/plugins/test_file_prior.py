from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.views import Views
from gvla2.testing import inputs
from gvla2.testing.reconstruction import check_prior
from gvla2_plugins.geofuse import FilePriorConfig, gvla2_geometry_priors


def views() -> Views:
    return inputs.views(masked=inputs.RED)


def stacked() -> np.ndarray:
    return np.stack([view.depth for view in views()])


def poses() -> np.ndarray:
    return np.stack([view.camera.world_from_camera for view in views()])


def prior(tmp_path: Path, **arrays):
    path = tmp_path / "prior.npz"
    np.savez(path, **arrays)
    (component,) = gvla2_geometry_priors()
    return component.build(FilePriorConfig(path=str(path)))


def test_it_keeps_the_contract(tmp_path):
    one, three = inputs.views(masked=inputs.RED)[0], stacked()

    class OneOrThree:
        """A file serves one set of views: the check asks for two."""

        def predict(self, asked: Views):
            count = len(asked)
            assert asked[0].name == one.name
            return prior(tmp_path, depth=three[:count]).predict(asked)

    check_prior(OneOrThree())


def test_depth_confidence_and_poses_come_back(tmp_path):
    depth = stacked()
    sure = np.random.default_rng(0).uniform(0, 2, depth.shape)
    found = prior(tmp_path, depth=depth, confidence=sure, world_from_camera=poses()[:, :3]).predict(views())
    np.testing.assert_array_equal(found.depth, depth)
    np.testing.assert_allclose(found.confidence, np.where(np.isfinite(depth), sure, 0), rtol=1e-6)
    np.testing.assert_allclose(found.world_from_camera, poses())


def test_what_is_no_depth_is_unknown(tmp_path):
    depth = stacked()
    depth[0, 0, :3] = [0.0, -1.0, np.inf]
    sure = np.ones_like(depth)
    sure[1, 0, 0] = np.nan
    sure[1, 0, 1] = -1
    found = prior(tmp_path, depth=depth, confidence=sure).predict(views())
    assert np.isnan(found.depth[0, 0, :3]).all()
    assert not found.confidence[0, 0, :3].any()
    assert not found.confidence[1, 0, :2].any()


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"other": np.zeros(3)}, r"needs depth \(S, h, w\)"),
        ({"depth": np.ones((4, 4))}, r"needs depth \(S, h, w\)"),
        ({"depth": np.ones((2, 24, 32))}, "of 3 views"),
        ({"depth": np.ones((3, 20, 90))}, "not the same shape"),
        ({"depth": np.full(stacked().shape, np.nan)}, "no depth in it"),
        ({"depth": stacked(), "confidence": np.ones((3, 2, 2))}, "must be alike"),
        ({"depth": stacked(), "world_from_camera": np.eye(4)}, r"world_from_camera must be \(3, 4, 4\)"),
        (
            {"depth": stacked(), "world_from_camera": poses()[:2]},
            r"must be \(3, 4, 4\), got shape \(2, 4, 4\)",
        ),
        ({"depth": stacked(), "world_from_camera": poses() @ np.diag([1.0, 1, -1, 1])}, "mirrored"),
        ({"depth": np.full((3, 2, 2), "far")}, "not numbers"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, arrays, words):
    with pytest.raises(GeometryError, match=words) as caught:
        prior(tmp_path, **arrays).predict(views())
    assert "prior.npz" in str(caught.value)


def test_a_file_that_is_no_archive_of_plain_arrays_is_refused(tmp_path):
    (component,) = gvla2_geometry_priors()
    np.savez(tmp_path / "pickle.npz", depth=np.array([{"a": 1}], dtype=object))
    np.save(tmp_path / "single.npy", np.ones(3))
    for name, content in (("cut.npz", b"PK\x03\x04 cut off"), ("text.npz", b"hello"), ("empty.npz", b"")):
        (tmp_path / name).write_bytes(content)
    for name in ("pickle.npz", "single.npy", "cut.npz", "text.npz", "empty.npz"):
        with pytest.raises(GeometryError, match="plain arrays"):
            component.build(FilePriorConfig(path=str(tmp_path / name))).predict(views())


@pytest.mark.parametrize(
    ("path", "words"), [("", "prior.path=FILE.npz"), ("nowhere.npz", "no file 'nowhere.npz'")]
)
def test_the_file_must_be_named_and_there(path, words):
    (component,) = gvla2_geometry_priors()
    with pytest.raises(ConfigurationError, match=words):
        component.build(FilePriorConfig(path=path))
