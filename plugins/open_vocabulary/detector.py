"""Detectors that search for given words: Grounding DINO and OWLv2, a box for each thing that a phrase names."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2_plugins.open_vocabulary.checkpoints import checkpoint_folder, loaded, transformers_for
from gvla2_plugins.open_vocabulary.perceiver import FoundMask

PURPOSE = "perceiver=detector"
KINDS = ("grounding-dino", "mm-grounding-dino", "owlv2", "owlvit")
SIDES = {"grounding-dino": 800, "mm-grounding-dino": 800}
"""Side in pixels of the square that pictures are stretched to, unless the checkpoint gives one."""
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
CLIP_MEAN, CLIP_DEVIATION = np.array([0.4815, 0.4578, 0.4082]), np.array([0.2686, 0.2613, 0.2758])


def load_detector(weights: str) -> Detector:
    """The model from a folder; raises :class:`MissingDependencyError` or :class:`ConfigurationError`."""
    folder, kind = checkpoint_folder(weights, PURPOSE, "IDEA-Research/grounding-dino-tiny", KINDS)
    transformers = transformers_for(PURPOSE)
    network = loaded(transformers.AutoModelForZeroShotObjectDetection, folder, PURPOSE)
    return Detector(network.eval(), loaded(transformers.AutoTokenizer, folder, PURPOSE), kind)


class Detector:
    """Finds by words: filled boxes, which depth cuts to shape."""

    def __init__(self, network: Any, tokenizer: Any, kind: str) -> None:
        self._network, self._tokenizer, self._owl = network, tokenizer, kind.startswith("owl")
        vision = getattr(network.config, "vision_config", None)
        self._side = int(vision.image_size) if self._owl and vision is not None else SIDES.get(kind, 800)

    def find(self, image: NDArray[np.uint8], words: list[str], threshold: float) -> list[FoundMask]:
        """Boxes of all words in one picture (H, W, 3), as masks."""
        import torch

        tensor = torch.from_numpy(self._pixels(image)[None])
        found = []
        for word in words:
            prompt = word if self._owl else f"{word.lower()}."
            text = self._tokenizer([prompt], return_tensors="pt", padding=True, truncation=True)
            with torch.inference_mode():
                answer = self._network(
                    pixel_values=tensor, input_ids=text["input_ids"], attention_mask=text["attention_mask"]
                )
            scores = answer.logits[0].sigmoid().amax(dim=-1).numpy()
            boxes = answer.pred_boxes[0].numpy()  # middle x, y, width, height in shares of the square
            for k in np.nonzero(scores > threshold)[0]:
                found.append(FoundMask(filled(boxes[k], image.shape[:2]), float(scores[k]), word, loose=True))
        return found

    def _pixels(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        mean, deviation = (CLIP_MEAN, CLIP_DEVIATION) if self._owl else (MEAN, DEVIATION)
        grown = Image.fromarray(image).resize((self._side, self._side), Image.Resampling.BILINEAR)
        pixels = (np.asarray(grown) / 255.0 - mean) / deviation
        return np.ascontiguousarray(pixels.transpose(2, 0, 1), dtype=np.float32)


def filled(box: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.bool_]:
    """The mask (H, W) of a box given by its middle and sides in shares of the picture."""
    x, y, width, height = (float(value) for value in box)
    rows, columns = np.indices(size)
    u, v = (columns + 0.5) / size[1], (rows + 0.5) / size[0]
    return np.asarray((np.abs(u - x) <= 0.5 * width) & (np.abs(v - y) <= 0.5 * height))
