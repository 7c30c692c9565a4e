"""SAM 3: one phrase, one picture, a mask for each thing that the phrase names."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2_plugins.open_vocabulary.checkpoints import checkpoint_folder, loaded, transformers_for
from gvla2_plugins.open_vocabulary.perceiver import FoundMask

PURPOSE = "perceiver=sam3"


def load_sam3(weights: str) -> Sam3:
    """The model from a folder; raises :class:`MissingDependencyError` or :class:`ConfigurationError`."""
    folder, _ = checkpoint_folder(weights, PURPOSE, "facebook/sam3", ("sam3", "sam3_video"))
    transformers = transformers_for(PURPOSE)
    network = loaded(transformers.Sam3Model, folder, PURPOSE)
    return Sam3(network.eval(), loaded(transformers.AutoTokenizer, folder, PURPOSE))


class Sam3:
    """Finds by words; the picture is encoded once for all of them."""

    def __init__(self, network: Any, tokenizer: Any) -> None:
        self._network, self._tokenizer = network, tokenizer
        self._side = int(network.config.vision_config.image_size)

    def find(self, image: NDArray[np.uint8], words: list[str], threshold: float) -> list[FoundMask]:
        """Masks of all words in one picture (H, W, 3)."""
        import torch

        size = (self._side, self._side)
        pixels = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BILINEAR)) / 127.5 - 1.0
        tensor = torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1)[None], dtype=np.float32))
        found = []
        with torch.inference_mode():
            features = self._network.get_vision_features(pixel_values=tensor)
            for word in words:
                limit = self._network.config.text_config.max_position_embeddings
                text = self._tokenizer(
                    word, return_tensors="pt", padding="max_length", max_length=limit, truncation=True
                )
                answer = self._network(
                    vision_embeds=features, input_ids=text["input_ids"], attention_mask=text["attention_mask"]
                )
                there = answer.presence_logits.sigmoid() if answer.presence_logits is not None else 1.0
                scores = (answer.pred_logits.sigmoid() * there)[0]
                kept = scores > threshold
                logits = answer.pred_masks[0][kept][:, None]
                masks = (
                    torch.nn.functional.interpolate(logits, image.shape[:2], mode="bilinear")
                    if len(logits)
                    else []
                )
                for mask, score in zip(masks, scores[kept], strict=True):
                    found.append(FoundMask(np.asarray(mask[0] > 0), float(score), word))
        return found
