"""Running VGGT on the views."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, GeometryError, MissingDependencyError, PluginError, reading
from gvla2.geometry.view_folders import nearest
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import GeometryEstimate

if TYPE_CHECKING:
    import torch

    from gvla2_plugins.vggt_prior import VggtPriorConfig


def decode_poses(encoding: ArrayLike) -> NDArray[np.float64]:
    """``world_from_camera`` (S, 4, 4), OpenCV axes, in the frame of the first camera and a scale of the network's own.

    A row of the encoding (S, 9) is a camera_from_world translation (3), rotation quaternion xyzw (4, of any length
    but zero), and two fields of view.
    """
    rows = np.asarray(encoding, dtype=np.float64)
    rotation = Rotation.from_quat(rows[:, 3:7]).as_matrix()  # camera from world
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = rotation.transpose(0, 2, 1)
    poses[:, :3, 3] = -np.einsum("sji,sj->si", rotation, rows[:, :3])
    return poses


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


def make_network() -> torch.nn.Module:
    """VGGT without weights; raises :class:`MissingDependencyError` without its package."""
    try:
        from vggt.models.vggt import VGGT
    except ImportError as error:
        raise MissingDependencyError("the package 'vggt'", PURPOSE, PACKAGE, PACKAGE_LICENCE) from error
    network: torch.nn.Module = VGGT()
    return network


def load_weights(network: torch.nn.Module, weights: str) -> None:
    """Fill the network from a checkpoint; every required weight must be present, in its shape.

    A checkpoint may hold more than the network (its tracking head, for example). Raises
    :class:`MissingDependencyError` when there is no file and :class:`ConfigurationError` when it does not fit.
    """
    path = Path(weights).expanduser()
    candidates = [path / name for name in _NAMES] if path.is_dir() else [path]
    found = next((file for file in candidates if weights and file.is_file()), None)
    if found is None:
        what = f"the VGGT-1B checkpoint ('{weights}')"
        raise MissingDependencyError(what, PURPOSE, WEIGHTS, WEIGHTS_LICENCE)
    with reading("VGGT's weights (prior.weights)", found, ConfigurationError):
        state = _read(found)
        missing = network.load_state_dict(state.get("model", state), strict=False).missing_keys
    if missing:
        some = ", ".join(missing[:3])
        raise ConfigurationError(
            f"prior.weights: '{found}' lacks {len(missing)} of the network's weights ({some} ...)."
        )


def _read(path: Path) -> dict[str, Any]:
    """The named tensors of a checkpoint: a checkpoint is data, it must not run code."""
    if path.suffix == ".safetensors":
        try:
            from safetensors.torch import load_file
        except ImportError as error:
            install = "pip install safetensors"
            raise MissingDependencyError("safetensors", f"Reading '{path}'", install) from error
        return load_file(path)
    state: dict[str, Any] = import_torch().load(path, map_location="cpu", weights_only=True)
    return state


_PATCH = 14


class VggtPrior:
    """Depth in VGGT's own frame and scale, with its cameras; guidance finds the scale and drops the cameras.

    ``network`` replaces VGGT, weights included. Raises
    :class:`MissingDependencyError` when torch, the package or the checkpoint are absent, and
    :class:`ConfigurationError` when options or checkpoint do not fit.
    """

    def __init__(self, config: VggtPriorConfig, network: torch.nn.Module | None = None) -> None:
        if config.width < _PATCH or config.width % _PATCH:
            raise ConfigurationError(f"prior.width must be a multiple of {_PATCH}, got {config.width}.")
        torch = import_torch()
        self._config = config
        self._device = config.device or ("cuda" if torch.cuda.is_available() else "cpu")
        if network is None:
            network = make_network()
            load_weights(network, config.weights)
        try:
            self._network = network.to(self._device).eval()
        except (RuntimeError, AssertionError) as error:
            raise ConfigurationError(f"prior.device: '{self._device}' cannot be used ({error}).") from error

    def predict(self, views: Views) -> GeometryEstimate:
        """Depth (S, H, W) at the views' size, with confidence and poses; the views must be of one size."""
        sizes = {(view.camera.height, view.camera.width) for view in views}
        if len(sizes) > 1:
            raise GeometryError(f"prior=vggt takes views of one size, got (height, width) {sorted(sizes)}.")
        height, width = sizes.pop()
        answer = self._run(np.stack([self._picture(view) for view in views]))
        poses = answer["pose_enc"]
        if poses.shape != (1, len(views), 9):
            raise PluginError(
                f"The network's pose_enc has shape {poses.shape}, expected (1, {len(views)}, 9)."
            )
        depth, confidence = (
            nearest(_maps(answer, key, len(views)), height, width) for key in ("depth", "depth_conf")
        )
        known = np.isfinite(depth) & (depth > 0) & np.isfinite(confidence)
        return GeometryEstimate(
            np.where(known, depth, np.nan).astype(np.float32),
            np.where(known, np.maximum(confidence, 0.0), 0.0).astype(np.float32),
            decode_poses(poses[0]),
        )

    def _picture(self, view: View) -> NDArray[np.float32]:
        """The view in the network's format: (3, h, w) in [0, 1], white outside the mask."""
        image = view.image.astype(np.float32)
        if view.mask is not None:
            image = 255.0 + (image - 255.0) * view.mask[..., None]
        width = self._config.width
        height = max(round(view.camera.height * width / view.camera.width / _PATCH), 1) * _PATCH
        small = Image.fromarray(np.clip(np.rint(image), 0, 255).astype(np.uint8)).resize(
            (width, height), Image.Resampling.BICUBIC
        )
        return (np.asarray(small, dtype=np.float32) / 255.0).transpose(2, 0, 1)

    def _run(self, images: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        torch = import_torch()
        batch = torch.from_numpy(np.ascontiguousarray(images)).to(self._device)
        half = self._device.startswith("cuda")
        precise = torch.bfloat16 if not half or torch.cuda.is_bf16_supported() else torch.float16
        with torch.inference_mode(), torch.autocast(self._device.partition(":")[0], precise, enabled=half):
            answer: Any = self._network(batch[None])
        wanted = ("pose_enc", "depth", "depth_conf")
        absent = [key for key in wanted if not isinstance(answer, dict) or key not in answer]
        if absent:
            raise PluginError(f"The network returned no {', '.join(absent)}: is it a VGGT?")
        return {key: answer[key].float().cpu().numpy() for key in wanted}


def _maps(answer: dict[str, NDArray[np.float32]], key: str, count: int) -> NDArray[np.float32]:
    """(S, h, w) of (1, S, h, w) or (1, S, h, w, 1)."""
    maps = answer[key][..., 0] if answer[key].shape[4:] == (1,) else answer[key]
    if maps.ndim != 4 or maps.shape[:2] != (1, count):
        raise PluginError(f"The network's {key} has shape {maps.shape}, expected (1, {count}, h, w).")
    return np.asarray(maps[0])
