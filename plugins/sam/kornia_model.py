"""SAM and MobileSAM checkpoints by kornia's own models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.perception.prompting import Prompt, Segments
from gvla2_plugins.sam.onnx_model import check_hash, encoded
from gvla2_plugins.sam.resizing import enlarged, squared

SIDE = 1024
GET = "the checkpoint of the Segment Anything or MobileSAM authors, then perceiver.weights=FILE.pt"
LICENCE = "Apache-2.0"


def load_sam(model: str, weights: str, sha256: dict[str, str]) -> SamByKornia:
    """The model ``vit_b``, ``vit_l``, ``vit_h`` or ``mobile_sam`` with a checkpoint's weights.

    Raises :class:`MissingDependencyError` without kornia or the file, :class:`ConfigurationError` for other weights.
    """
    file = Path(weights).expanduser()
    if not weights or not file.is_file():
        raise MissingDependencyError(
            f"a checkpoint of {model} ('{weights}')", f"perceiver.model={model}", GET, LICENCE
        )
    check_hash(file, sha256.get(file.name, ""))
    try:
        from kornia.models.sam import Sam, SamConfig  # type: ignore[attr-defined]
    except ImportError as error:
        install = "pip install 'gvla2[segmentation]'"
        raise MissingDependencyError("kornia", f"perceiver.model={model}", install) from error
    return SamByKornia(fill(Sam.from_config(SamConfig(model)), file), SIDE)


def fill(network: Any, file: Path) -> Any:
    """The network with a checkpoint's weights; all must be there and fit."""
    import torch

    try:
        # Tensors only: a checkpoint is data, it must not run code.
        state = torch.load(file, map_location="cpu", weights_only=True)
        network.load_state_dict(state)
    except Exception as error:  # torch raises whatever the broken part raises
        raise ConfigurationError(
            f"perceiver.weights: {file} holds no weights of this model: {error}"
        ) from error
    return network.eval()


class SamByKornia:
    """A :class:`~gvla2.perception.prompting.Segmenter` about a ``kornia.models.sam.Sam``; ``side`` is its input's."""

    def __init__(self, network: Any, side: int) -> None:
        self._network, self._side = network, side

    def encode(self, image: NDArray[np.uint8]) -> EncodedByKornia:
        """Look at one picture (H, W, 3) RGB."""
        import torch

        with torch.inference_mode():
            features = self._network.image_encoder(torch.from_numpy(squared(image, self._side)[None]))
        return EncodedByKornia(self._network, features, image.shape[:2], self._side)


class EncodedByKornia:
    """A picture's features, ready for prompts."""

    def __init__(self, network: Any, features: Any, size: tuple[int, int], side: int) -> None:
        self._network, self._features, self._size, self._side = network, features, size, side

    def segment(self, prompts: list[Prompt]) -> Segments:
        """The masks that the prompts mean; K = 0 is allowed."""
        found = [self._one(prompt) for prompt in prompts]
        if not found:
            return Segments(np.zeros((0, 1, *self._size), np.float32), np.zeros((0, 1)))
        return Segments(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _one(self, prompt: Prompt) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        import torch

        coordinates, labels = (torch.from_numpy(a) for a in encoded([prompt], self._size, self._side))
        corners = 2 * (prompt.box is not None)
        points = (coordinates[:, corners:], labels[:, corners:]) if len(prompt.points) else None
        boxes = coordinates[:, :2].reshape(1, 4) if corners else None
        with torch.inference_mode():
            sparse, dense = self._network.prompt_encoder(points=points, boxes=boxes, masks=None)
            logits, scores = self._network.mask_decoder(
                image_embeddings=self._features,
                image_pe=self._network.prompt_encoder.get_dense_pe(),
                sparse_prompt_embeddings=sparse,
                dense_prompt_embeddings=dense,
                multimask_output=True,
            )
        return enlarged(logits.numpy(), self._size), np.clip(scores.numpy().astype(np.float64), 0.0, 1.0)
