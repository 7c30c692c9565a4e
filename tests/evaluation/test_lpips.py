import numpy as np
import pytest
import torch
from torch.nn import functional

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.evaluation.lpips import Lpips, Weights, read_weights

SHAPES = ((11, 11, 3, 64), (5, 5, 64, 192), (3, 3, 192, 384), (3, 3, 384, 256), (3, 3, 256, 256))


@pytest.fixture
def weights() -> Weights:
    rng = np.random.default_rng(0)

    def array(*shape):
        return rng.normal(0, 1 / np.sqrt(np.prod(shape[:-1])), shape).astype(np.float32)

    kernels = tuple(array(*shape) for shape in SHAPES)
    return Weights(kernels, tuple(array(s[3]) for s in SHAPES), tuple(np.abs(array(s[3])) for s in SHAPES))


def with_torch(weights: Weights, a: np.ndarray, b: np.ndarray) -> float:
    def features(image):
        x = torch.from_numpy(2 * image.astype(np.float32) - 1).permute(2, 0, 1)[None]
        x = (x - torch.tensor([-0.030, -0.088, -0.188]).view(1, 3, 1, 1)) / torch.tensor(
            [0.458, 0.448, 0.450]
        ).view(1, 3, 1, 1)
        for n, (stride, padding) in enumerate(((4, 2), (1, 2), (1, 1), (1, 1), (1, 1))):
            if n in (1, 2):
                x = functional.max_pool2d(x, 3, 2)
            kernel = torch.from_numpy(weights.kernels[n]).permute(3, 2, 0, 1)
            x = functional.relu(
                functional.conv2d(x, kernel, torch.from_numpy(weights.biases[n]), stride, padding)
            )
            yield x / (x.pow(2).sum(1, keepdim=True).sqrt() + 1e-10)

    total = 0.0
    for n, (x, y) in enumerate(zip(features(a), features(b), strict=True)):
        head = torch.from_numpy(weights.heads[n]).view(1, -1, 1, 1)
        total += float(((x - y).pow(2) * head).sum(1).mean())
    return total


@pytest.mark.parametrize("size", [(64, 64), (67, 90)])
def test_the_forward_pass_is_that_of_a_deep_learning_library(weights, size):
    rng = np.random.default_rng(1)
    a, b = rng.random((*size, 3)), rng.random((*size, 3))
    lpips = Lpips(weights)
    assert lpips(a, b) == pytest.approx(with_torch(weights, a, b), rel=1e-4)
    assert lpips(a, a) == 0
    assert lpips(a, b) > 0


def test_weights_are_read_from_a_file_and_damaged_ones_are_named(weights, tmp_path):
    own = tmp_path / "mine.npz"
    arrays = {
        f"{name}{n}": array
        for name, found in (("kernel", weights.kernels), ("bias", weights.biases), ("head", weights.heads))
        for n, array in enumerate(found)
    }
    np.savez(own, **arrays)
    np.testing.assert_array_equal(read_weights(own).heads[4], weights.heads[4])
    np.savez(own, **{**arrays, "kernel2": np.ones((3, 3, 5, 5), dtype=np.float32)})
    with pytest.raises(ConfigurationError, match="wrong shape"):
        read_weights(own)
    own.write_bytes(own.read_bytes()[:1000])
    with pytest.raises(ConfigurationError, match=r"scripts/fetch_lpips"):
        read_weights(own)
    with pytest.raises(MissingDependencyError, match=r"scripts/fetch_lpips"):
        read_weights(tmp_path / "absent.npz")
