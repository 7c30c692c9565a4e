"""SAM 3 from a local checkpoint: masks of named objects in every picture, fused into one scene."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, MissingDependencyError, reading
from gvla2.geometry.views import Observation
from gvla2.perception.clusters import MaskCandidate, fuse, objects_of
from gvla2.perception.frames import frames_of
from gvla2.perception.labels import labelled
from gvla2.perception.objects import numbered, over_workspace
from gvla2.perception.options import labellers
from gvla2.planning.scene import Box, Scene

if TYPE_CHECKING:
    from gvla2_plugins.open_vocabulary import VocabularyConfig

PURPOSE = "perceiver=sam3"
GET = "huggingface-cli download facebook/sam3 --local-dir FOLDER, then perceiver.weights=FOLDER"
KINDS = ("sam3", "sam3_video")
"""The ``model_type`` of checkpoints that can be loaded."""


_BETWEEN = re.compile(
    r"\b(?:pick|lift|put|place|move|push|pull|open|close|take|grasp|slide|sort|stack|insert|turn|press|up|down|in|into|on|"
    r"onto|to|from|of|off|out|at|by|the|a|an|all|left|right|front|behind|next|between|and|then|it|its|with)\b|[^\w\s-]"
)
"""Words and punctuation between the names of objects in an instruction."""


class VocabularyPerceiver:
    """Asks a model for masks of named objects; depth places them."""

    def __init__(self, config: VocabularyConfig, finder: Sam3) -> None:
        if not 0 < config.threshold < 1 or config.min_points < 3:
            raise ConfigurationError(
                "perceiver=sam3: threshold must be in (0, 1) and min_points at least 3, got "
                f"{config.threshold} and {config.min_points}."
            )
        self._config, self._finder = config, finder
        self._labellers = labellers(config)

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene inside ``workspace``; raises :class:`PerceptionError` like every perceiver."""
        frames, table, notes = frames_of(observation.views, workspace)
        words = list(self._config.words) or named_in(instruction)
        if not words:
            notes.append("The instruction names nothing to look for: give perceiver.words=[...].")
        candidates = [
            replace(found, view=number)
            for number, frame in enumerate(frames if words else ())
            for found in self._finder.find(frame.view.image, words, self._config.threshold)
        ]
        objects, small = objects_of(fuse(frames, candidates), frames, table, self._config.min_points)
        inside = numbered(over_workspace(objects, workspace))
        scene = Scene(inside, table.height_over(workspace), workspace, "sam3", (*notes, *small))
        return labelled(scene, observation, self._labellers)


def named_in(instruction: str) -> list[str]:
    """The noun phrases of an instruction, each once, in its order."""
    phrases = (" ".join(p.split()) for p in _BETWEEN.sub("\0", instruction.casefold()).split("\0"))
    return [p for p in dict.fromkeys(phrases) if p]


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
        import transformers
    except ImportError as error:
        raise MissingDependencyError("transformers", PURPOSE, "pip install 'gvla2[segmentation]'") from error
    with reading("perceiver.weights", folder, ConfigurationError):
        kind = str(json.loads(file.read_text("utf-8")).get("model_type"))
        if kind not in KINDS:
            raise ConfigurationError(
                f"perceiver.weights: {folder} is a '{kind}'; {PURPOSE} loads {', '.join(KINDS)}."
            )
        network = transformers.Sam3Model.from_pretrained(folder, local_files_only=True)
        tokenizer = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)
    return Sam3(network.eval(), tokenizer)


class Sam3:
    """Finds objects by words; the picture is encoded once for all of them."""

    def __init__(self, network: Any, tokenizer: Any) -> None:
        self._network, self._tokenizer = network, tokenizer
        self._side = int(network.config.vision_config.image_size)

    def find(self, image: NDArray[np.uint8], words: list[str], threshold: float) -> list[MaskCandidate]:
        """Masks of all words in one picture (H, W, 3), as of view 0."""
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
                    found.append(MaskCandidate(0, np.asarray(mask[0] > 0), float(score), word))
        return found
