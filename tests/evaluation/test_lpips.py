import hashlib
import io
import pickle
import tarfile
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.lpips import (
    ARCHIVE,
    MEMBER,
    Lpips,
    Weights,
    keep_weights,
    read_weights,
    weights_path,
)

SHAPES = ((11, 11, 3, 64), (5, 5, 64, 192), (3, 3, 192, 384), (3, 3, 384, 256), (3, 3, 256, 256))


def random_tree() -> dict:
    rng = np.random.default_rng(0)

    def array(*shape):
        return rng.normal(0, 1 / np.sqrt(np.prod(shape[:-1])), shape).astype(np.float32)

    layers = {f"Conv_{n}": {"kernel": array(*s), "bias": array(1, s[3])[0]} for n, s in enumerate(SHAPES)}
    heads = {
        f"NetLinLayer_{n}": {"Conv_0": {"kernel": np.abs(array(1, 1, s[3], 1))}} for n, s in enumerate(SHAPES)
    }
    return {"AlexNet_0": layers, **heads}


def archive_of(tree: object, folder: Path) -> tuple[Path, str]:
    content = pickle.dumps(tree, protocol=3)
    path = folder / ARCHIVE
    with tarfile.open(path, "w:gz", compresslevel=0) as bundle:
        member = tarfile.TarInfo(MEMBER)
        member.size = len(content)
        bundle.addfile(member, io.BytesIO(content))
    return path, hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def weights(tmp_path) -> Weights:
    keep_weights(*archive_of(random_tree(), tmp_path))
    return read_weights()


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


def test_another_archive_is_not_used(tmp_path):
    path, _ = archive_of(random_tree(), tmp_path)
    with pytest.raises(Gvla2Error, match="pinned"):
        keep_weights(path)
    assert not weights_path().exists()


def test_damaged_weights_are_named(weights):
    weights_path().write_bytes(weights_path().read_bytes()[:1000])
    with pytest.raises(ConfigurationError, match=r"python -m gvla2\.evaluation\.lpips"):
        read_weights()


def test_weights_of_ones_own(weights, tmp_path):
    own = tmp_path / "mine.npz"
    arrays = dict(np.load(weights_path()))
    np.savez(own, **arrays)
    assert read_weights(own).kernels[0].shape == SHAPES[0]
    np.savez(own, **{**arrays, "head2": np.ones(5, dtype=np.float32)})
    with pytest.raises(ConfigurationError, match="wrong shape"):
        read_weights(own)
    np.savez(own, kernel0=arrays["kernel0"])
    with pytest.raises(ConfigurationError, match="does not hold LPIPS weights"):
        read_weights(own)
