"""SAM 2 through ONNX Runtime."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, MissingDependencyError, reading
from gvla2.perception.clicks import Prompt, Segments

MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
"""Mean and standard deviation of ImageNet's pixels, by which the model's input is normalised."""
SIDE = 1024
"""Side of the square that pictures are stretched to, pixels."""
BATCH = 8
"""Prompts in one call of the decoder: more need memory and are no faster."""
FEATURES = ("image_embed", "high_res_feats_0", "high_res_feats_1")
DECODER_INPUTS = (*FEATURES, "point_coords", "point_labels", "mask_input", "has_mask_input")
GET = "scripts/fetch_sam, then perceiver.weights=FOLDER (SAM 2 tiny as ONNX, 151 MB)"


class Sam2Onnx:
    """A :class:`~gvla2.perception.clicks.Segmenter` from a folder with one encoder and one decoder.

    Raises :class:`MissingDependencyError` without ONNX Runtime or files, :class:`ConfigurationError` for another model.
    """

    def __init__(self, folder: str) -> None:
        encoder, decoder = model_files(folder)
        self._encoder, self._decoder = _session(str(encoder)), _session(str(decoder))
        _check_names(encoder, self._encoder, ("image",), FEATURES)
        _check_names(decoder, self._decoder, DECODER_INPUTS, ("masks", "iou_predictions"))

    def encode(self, image: NDArray[np.uint8]) -> Callable[[list[Prompt]], Segments]:
        """Encode one picture (H, W, 3) RGB."""
        grown = Image.fromarray(image).resize((SIDE, SIDE), Image.Resampling.BILINEAR)
        pixels = ((np.asarray(grown) / 255.0 - MEAN) / DEVIATION).transpose(2, 0, 1)
        inputs = {"image": np.ascontiguousarray(pixels[None], dtype=np.float32)}
        features = dict(zip(FEATURES, self._encoder.run(list(FEATURES), inputs), strict=True))
        return partial(self._segment, features, image.shape[:2])

    def _segment(
        self, features: dict[str, NDArray[np.float32]], size: tuple[int, int], prompts: list[Prompt]
    ) -> Segments:
        masks, scores = list[NDArray[np.bool_]](), list[NDArray[np.float64]]()
        for start in range(0, len(prompts), BATCH):
            coordinates, labels = _encoded(prompts[start : start + BATCH], size)
            logits, found = self._decoder.run(
                ["masks", "iou_predictions"],
                {
                    **features,
                    "point_coords": coordinates,
                    "point_labels": labels,
                    "mask_input": np.zeros((len(labels), 1, SIDE // 4, SIDE // 4), np.float32),
                    "has_mask_input": np.zeros(1, np.float32),
                },
            )
            grown = [
                [np.asarray(Image.fromarray(m).resize(size[::-1], Image.Resampling.BILINEAR)) for m in each]
                for each in logits
            ]
            masks.append(np.array(grown) > 0)
            scores.append(np.clip(found.astype(np.float64), 0.0, 1.0))
        return Segments(np.concatenate(masks), np.concatenate(scores))


def _encoded(prompts: list[Prompt], size: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points (K, P, 2) in pixels of the square, and their labels (K, P): 1 for a click, 2 and 3 for a box's corners, -1
    for none.
    """
    stretch = np.array([SIDE / size[1], SIDE / size[0]])
    longest = max(len(p.points) + 2 * (p.box is not None) for p in prompts)
    coordinates = np.zeros((len(prompts), longest, 2), np.float32)
    labels = np.full((len(prompts), longest), -1, np.float32)
    for k, prompt in enumerate(prompts):
        corners = np.zeros((0, 2)) if prompt.box is None else np.array(prompt.box).reshape(2, 2)
        points = np.concatenate([corners, prompt.points.reshape(-1, 2)]) * stretch
        marks = [2, 3][: len(corners)] + [1] * len(prompt.points)
        coordinates[k, : len(points)], labels[k, : len(points)] = points, marks
    return coordinates, labels


def model_files(folder: str) -> tuple[Path, Path]:
    """The one encoder and the one decoder in a folder; raises :class:`MissingDependencyError`."""
    place = Path(folder).expanduser()
    found = sorted(p for p in place.glob("*") if p.suffix in (".onnx", ".ort")) if folder else []
    pair = [[p for p in found if part in p.name.lower()] for part in ("encoder", "decoder")]
    if any(len(files) != 1 for files in pair):
        named = ", ".join(p.name for p in found) or "no .onnx or .ort file"
        what = f"one encoder and one decoder of SAM 2 ({place if folder else 'perceiver.weights'}: {named})"
        raise MissingDependencyError(what, "perceiver=sam", GET, "Apache-2.0")
    return pair[0][0], pair[1][0]


@cache
def _session(path: str) -> Any:
    """One session per file and process: the weights take hundreds of megabytes."""
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingDependencyError("onnxruntime", "perceiver=sam", "pip install 'gvla2[sam]'") from error
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    options.enable_mem_pattern = False  # a second set of buffers: 600 MB that save no time
    with reading("a model for ONNX Runtime", path, ConfigurationError):
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def _check_names(file: Path, session: Any, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    names = {value.name for value in (*session.get_inputs(), *session.get_outputs())}
    lacking = [name for name in (*inputs, *outputs) if name not in names]
    if lacking:
        raise ConfigurationError(
            f"{file} is another model than SAM 2: it lacks {', '.join(lacking)}; it has {', '.join(sorted(names))}."
        )
