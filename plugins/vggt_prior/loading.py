"""Making the network and filling it with weights from local files."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.errors import ConfigurationError, MissingDependencyError

if TYPE_CHECKING:
    import torch

PURPOSE = "prior=vggt"
PACKAGE = "pip install git+https://github.com/facebookresearch/vggt"
PACKAGE_LICENCE = "the VGGT licence, see its repository"
WEIGHTS = "huggingface-cli download facebook/VGGT-1B --local-dir FOLDER, then prior.weights=FOLDER"
WEIGHTS_LICENCE = "CC-BY-NC-4.0, no commercial use"
_NAMES = ("model.safetensors", "model.pt")


def import_torch() -> Any:
    """The module torch, or an error on how to install it."""
    try:
        import torch
    except ImportError as error:
        raise MissingDependencyError("torch", PURPOSE, 'pip install "gvla2[perception]"') from error
    return torch


def make_network(factory: str) -> torch.nn.Module:
    """The network that ``module:callable`` makes, without weights of its own."""
    module_name, _, attribute = factory.partition(":")
    if not module_name or not attribute:
        raise ConfigurationError(f"prior.factory must read 'module:callable', got '{factory}'.")
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        root = module_name.partition(".")[0]
        if root == "vggt":
            raise MissingDependencyError("the package 'vggt'", PURPOSE, PACKAGE, PACKAGE_LICENCE) from error
        raise ConfigurationError(f"prior.factory: '{module_name}' cannot be imported ({error}).") from error
    make = getattr(module, attribute, None)
    if not callable(make):
        raise ConfigurationError(f"prior.factory: module '{module_name}' has no callable '{attribute}'.")
    return make()


def load_weights(network: torch.nn.Module, weights: str) -> None:
    """Fill the network from a checkpoint; every required weight must be present, in its shape.

    A checkpoint may hold more than the network (its tracking head, for example). Raises
    :class:`MissingDependencyError` when there is no file and :class:`ConfigurationError` when it does not fit.
    """
    path = _find(weights)
    state = _read(path)
    try:
        missing = network.load_state_dict(state, strict=False).missing_keys
    except RuntimeError as error:
        raise ConfigurationError(
            f"prior.weights: '{path}' holds another network's weights: {error}"
        ) from error
    if missing:
        some = ", ".join(missing[:3])
        raise ConfigurationError(
            f"prior.weights: '{path}' lacks {len(missing)} of the network's weights ({some} ...)."
        )


def _find(weights: str) -> Path:
    if not weights:
        raise MissingDependencyError("the VGGT-1B checkpoint", PURPOSE, WEIGHTS, WEIGHTS_LICENCE)
    path = Path(weights).expanduser()
    candidates = [path / name for name in _NAMES] if path.is_dir() else [path]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    looked = " or ".join(f"'{candidate}'" for candidate in candidates)
    raise MissingDependencyError(f"the VGGT-1B checkpoint ({looked})", PURPOSE, WEIGHTS, WEIGHTS_LICENCE)


def _read(path: Path) -> dict[str, Any]:
    if path.suffix == ".safetensors":
        try:
            from safetensors.torch import load_file
        except ImportError as error:
            raise MissingDependencyError(
                "safetensors", f"Reading '{path}'", "pip install safetensors"
            ) from error
        return load_file(path)
    torch = import_torch()
    try:
        # Tensors only: a checkpoint is data, it must not run code.
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch can raise anything
        raise ConfigurationError(
            f"prior.weights: '{path}' is not a checkpoint of tensors ({error})."
        ) from error
    if isinstance(state, dict) and isinstance(state.get("model"), dict):
        state = state["model"]
    if not isinstance(state, dict):
        raise ConfigurationError(f"prior.weights: '{path}' holds {type(state).__name__}, not named tensors.")
    return state
