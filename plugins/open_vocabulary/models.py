"""Models that find objects by words, from local checkpoints: SAM 3, Grounding DINO and OWLv2."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2_plugins.open_vocabulary.perceiver import FoundMask

GET = "huggingface-cli download {} --local-dir FOLDER, then perceiver.weights=FOLDER"


def checkpoint_folder(weights: str, purpose: str, example: str, kinds: tuple[str, ...]) -> tuple[Path, str]:
    """The folder and the model's kind in its config.json, one of ``kinds``.

    Raises :class:`MissingDependencyError` if there is none, :class:`ConfigurationError` for another model's.
    """
    folder = Path(weights).expanduser()
    file = folder / "config.json"
    if not weights or not file.is_file():
        raise MissingDependencyError(
            f"a checkpoint ('{file if weights else ''}')", purpose, GET.format(example)
        )
    try:
        kind = str(json.loads(file.read_text("utf-8")).get("model_type"))
    except (OSError, ValueError, AttributeError) as error:
        raise ConfigurationError(f"perceiver.weights: {file} cannot be read: {error}") from error
    if kind not in kinds:
        raise ConfigurationError(
            f"perceiver.weights: {folder} is a '{kind}'; {purpose} loads {', '.join(kinds)}."
        )
    return folder, kind


def loaded(factory: Any, folder: Path, purpose: str) -> Any:
    """``factory.from_pretrained`` of local files; raises :class:`ConfigurationError` if they do not fit."""
    try:
        return factory.from_pretrained(folder, local_files_only=True)
    except Exception as error:  # transformers can raise anything
        raise ConfigurationError(
            f"perceiver.weights: {folder} does not load for {purpose}: {error}"
        ) from error


def transformers_for(purpose: str) -> Any:
    """The package, or an error on how to install it."""
    try:
        import transformers
    except ImportError as error:
        raise MissingDependencyError("transformers", purpose, "pip install 'gvla2[segmentation]'") from error
    return transformers


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


DETECTING = "perceiver=detector"
KINDS = ("grounding-dino", "mm-grounding-dino", "owlv2", "owlvit")
SIDES = {"grounding-dino": 800, "mm-grounding-dino": 800}
"""Side in pixels of the square that pictures are stretched to, unless the checkpoint gives one."""
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
CLIP_MEAN, CLIP_DEVIATION = np.array([0.4815, 0.4578, 0.4082]), np.array([0.2686, 0.2613, 0.2758])


def load_detector(weights: str) -> Detector:
    """The model from a folder; raises :class:`MissingDependencyError` or :class:`ConfigurationError`."""
    folder, kind = checkpoint_folder(weights, DETECTING, "IDEA-Research/grounding-dino-tiny", KINDS)
    transformers = transformers_for(DETECTING)
    network = loaded(transformers.AutoModelForZeroShotObjectDetection, folder, DETECTING)
    return Detector(network.eval(), loaded(transformers.AutoTokenizer, folder, DETECTING), kind)


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
