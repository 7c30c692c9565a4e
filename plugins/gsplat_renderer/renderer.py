"""Conversion of Gaussians and cameras for gsplat, and of its output for the protocol."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2_plugins.gsplat_renderer import GsplatRendererConfig

_WHAT = "renderer=gsplat"
_LARGEST_LOGIT = (
    80.0  # beyond it the sigmoid is 0 or 1 in float32 anyway, and gsplat's kernels see no infinity
)
_SMALLEST_LOG_SCALE = -60.0


class GsplatRenderer:
    """Renders with ``gsplat.rasterization`` on a CUDA device.

    Raises :class:`MissingDependencyError` when gsplat, torch or a CUDA device is missing, and
    :class:`ConfigurationError` for invalid options.
    """

    def __init__(self, config: GsplatRendererConfig) -> None:
        if config.near <= 0 or config.low_pass < 0 or not config.device.startswith("cuda"):
            raise ConfigurationError(
                f"{_WHAT} needs near > 0, low_pass >= 0 and a CUDA device such as cuda:0, got {config.near}, "
                f"{config.low_pass} and '{config.device}'."
            )
        self._config = config
        self._torch, self._rasterization = _load(config.device)

    def render(
        self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Image (H, W, 3) and alpha (H, W), both float32 in [0, 1]; the image has the background added."""
        if len(gaussians) == 0:
            image = np.broadcast_to(np.asarray(background, np.float32), (camera.height, camera.width, 3))
            return image.copy(), np.zeros((camera.height, camera.width), np.float32)
        with self._torch.inference_mode():
            colours, alphas, _ = self._rasterization(
                **arguments(self._torch, gaussians, camera, background, self._config)
            )
        image = colours[0, ..., :3].clamp(0, 1).cpu().numpy()
        alpha = alphas[0, ..., 0].clamp(0, 1).cpu().numpy()
        return image.astype(np.float32, copy=False), alpha.astype(np.float32, copy=False)


def arguments(
    torch: Any,
    gaussians: Gaussians,
    camera: Camera,
    background: tuple[float, float, float],
    config: GsplatRendererConfig,
) -> dict[str, Any]:
    """Keyword arguments of ``gsplat.rasterization`` for one camera.

    gsplat takes spherical harmonics as (N, K, 3), the constant one first, where files hold channel by channel.
    """

    def tensor(array: Any) -> Any:
        return torch.tensor(np.asarray(array, np.float32), device=config.device)

    count = len(gaussians)
    harmonics = gaussians.sh_dc[:, None, :]
    if gaussians.sh_rest is not None:
        rest = gaussians.sh_rest.reshape(count, 3, -1).transpose(0, 2, 1)
        harmonics = np.concatenate([harmonics, rest], axis=1)
    return {
        "means": tensor(gaussians.centres),
        "quats": tensor(gaussians.rotations),
        "scales": torch.exp(tensor(np.maximum(gaussians.log_scales, _SMALLEST_LOG_SCALE))),
        "opacities": torch.sigmoid(
            tensor(np.clip(gaussians.opacity_logits, -_LARGEST_LOGIT, _LARGEST_LOGIT))
        ),
        "colors": tensor(harmonics),
        "sh_degree": round(np.sqrt(harmonics.shape[1])) - 1,
        "viewmats": tensor(camera.camera_from_world)[None],
        "Ks": tensor(camera.K)[None],
        "width": camera.width,
        "height": camera.height,
        "near_plane": config.near,
        "eps2d": config.low_pass,
        "backgrounds": tensor(background)[None],
        "render_mode": "RGB",
        "packed": False,
    }


def _load(device: str) -> tuple[Any, Any]:
    """Torch and gsplat's rasterization."""
    try:
        import torch
    except ImportError as error:
        raise MissingDependencyError(
            "torch", _WHAT, "pip install torch gsplat (the torch built for your CUDA)", "BSD-3-Clause"
        ) from error
    if not torch.cuda.is_available() or torch.device(device).index not in (
        None,
        *range(torch.cuda.device_count()),
    ):
        raise MissingDependencyError(
            f"a torch that finds the CUDA device '{device}' (torch {torch.__version__} sees "
            f"{torch.cuda.device_count()} of them)",
            _WHAT,
            "pip install gsplat, and the torch built for your CUDA, on a machine with an NVIDIA GPU; "
            "renderer=numba needs neither",
            "gsplat: Apache-2.0",
        )
    try:
        from gsplat import rasterization
    except ImportError as error:
        raise MissingDependencyError("gsplat", _WHAT, "pip install gsplat", "Apache-2.0") from error
    return torch, rasterization
