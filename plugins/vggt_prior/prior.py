"""Running VGGT on the views."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, GeometryError, PluginError
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2_plugins.vggt_prior.loading import import_torch, load_weights, make_network
from gvla2_plugins.vggt_prior.pose_encoding import decode_poses

if TYPE_CHECKING:
    import torch

    from gvla2_plugins.vggt_prior import VggtPriorConfig

_PATCH = 14


class VggtPrior:
    """Depth in VGGT's own frame and scale, with its cameras; guidance finds the scale and drops the cameras.

    ``network`` replaces the one that the configuration names, weights included. Raises
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
            network = make_network(config.factory)
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
        depth = self._maps(answer, "depth", len(views))
        confidence = self._maps(answer, "depth_conf", len(views))
        poses = answer["pose_enc"]
        if poses.shape != (1, len(views), 9):
            raise PluginError(
                f"The network's pose_enc has shape {poses.shape}, expected (1, {len(views)}, 9)."
            )
        world_from_camera, _ = decode_poses(poses[0])
        depth, confidence = (_resized(maps, height, width) for maps in (depth, confidence))
        known = np.isfinite(depth) & (depth > 0) & np.isfinite(confidence)
        return GeometryEstimate(
            np.where(known, depth, np.nan).astype(np.float32),
            np.where(known, np.maximum(confidence, 0.0), 0.0).astype(np.float32),
            world_from_camera,
        )

    def _picture(self, view: View) -> NDArray[np.float32]:
        """The view in the network's format: (3, h, w) in [0, 1]."""
        image = view.image.astype(np.float32)
        if self._config.white_background and view.mask is not None:
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
            raise PluginError(f"The network returned no {', '.join(absent)}: is prior.factory a VGGT?")
        return {key: answer[key].float().cpu().numpy() for key in wanted}

    def _maps(self, answer: dict[str, NDArray[np.float32]], key: str, count: int) -> NDArray[np.float32]:
        """(S, h, w) of (1, S, h, w) or (1, S, h, w, 1)."""
        maps = answer[key]
        if maps.ndim == 5 and maps.shape[-1] == 1:
            maps = maps[..., 0]
        if maps.ndim != 4 or maps.shape[:2] != (1, count):
            raise PluginError(f"The network's {key} has shape {maps.shape}, expected (1, {count}, h, w).")
        return np.asarray(maps[0])


def _resized(maps: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Maps (S, h, w) at another size, by the nearest pixel, which invents no depth between surfaces."""
    rows = ((np.arange(height) + 0.5) * maps.shape[1] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * maps.shape[2] / width).astype(int)
    return np.asarray(maps[:, rows[:, None], columns])
