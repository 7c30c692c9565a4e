"""SAM 3 from a local checkpoint."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2_plugins.open_vocabulary.perceiver import FoundMask

PURPOSE = "perceiver=sam3"
GET = "huggingface-cli download facebook/sam3 --local-dir FOLDER, then perceiver.weights=FOLDER"
KINDS = ("sam3", "sam3_video")
"""The ``model_type`` of checkpoints that can be loaded."""


def load_sam3(weights: str) -> Sam3:
    """The model in a folder of local files.

    Raises :class:`MissingDependencyError` without transformers or a checkpoint, :class:`ConfigurationError` for another
    model's checkpoint or a broken one.
    """
    folder = Path(weights).expanduser()
    file = folder / "config.json"
    if not weights or not file.is_file():
        raise MissingDependencyError(f"a checkpoint ('{file if weights else ''}')", PURPOSE, GET)
    try:
        kind = str(json.loads(file.read_text("utf-8")).get("model_type"))
    except (OSError, ValueError, AttributeError) as error:
        raise ConfigurationError(f"perceiver.weights: {file} cannot be read: {error}") from error
    if kind not in KINDS:
        raise ConfigurationError(
            f"perceiver.weights: {folder} is a '{kind}'; {PURPOSE} loads {', '.join(KINDS)}."
        )
    try:
        import transformers
    except ImportError as error:
        raise MissingDependencyError("transformers", PURPOSE, "pip install 'gvla2[segmentation]'") from error
    try:
        network = transformers.Sam3Model.from_pretrained(folder, local_files_only=True)
        tokenizer = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)
    except Exception as error:  # transformers can raise anything
        raise ConfigurationError(f"perceiver.weights: {folder} does not load: {error}") from error
    return Sam3(network.eval(), tokenizer)


class Sam3:
    """Finds objects by words; the picture is encoded once for all of them."""

    def __init__(self, network: Any, tokenizer: Any) -> None:
        self._network, self._tokenizer = network, tokenizer
        self._side = int(network.config.vision_config.image_size)

    def find(self, image: NDArray[np.uint8], words: list[str], threshold: float) -> list[FoundMask]:
        """Masks of all words in one picture (H, W, 3)."""
        import torch

        size = (self._side, self._side)
        pixels = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BILINEAR)) / 127.5 - 1.0
        tensor = torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1)[None], dtype=np.float32))
        limit = self._network.config.text_config.max_position_embeddings
        found = []
        with torch.inference_mode():
            features = self._network.get_vision_features(pixel_values=tensor)
            for word in words:
                text = self._tokenizer(
                    word, return_tensors="pt", padding="max_length", max_length=limit, truncation=True
                )
                answer = self._network(
                    vision_embeds=features, input_ids=text["input_ids"], attention_mask=text["attention_mask"]
                )
                there = answer.presence_logits.sigmoid() if answer.presence_logits is not None else 1.0
                scores = (answer.pred_logits.sigmoid() * there)[0]
                kept = scores > threshold
                if not kept.any():
                    continue
                logits = answer.pred_masks[0][kept][:, None]
                masks = torch.nn.functional.interpolate(logits, image.shape[:2], mode="bilinear")
                for mask, score in zip(masks, scores[kept], strict=True):
                    found.append(FoundMask(np.asarray(mask[0] > 0), float(score), word))
        return found
