"""SAM 2 as two ONNX files, run by ONNX Runtime on the CPU.

The encoder takes ``image`` (1, 3, 1024, 1024), normalised; the decoder takes its three feature maps, points with labels
(1 on the thing, 0 beside it, 2 and 3 a box's corners, -1 padding) in pixels of that square, and gives low-resolution
logits with an estimate of each mask's IoU.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.perception.prompting import Prompt, Segments
from gvla2_plugins.sam.resizing import enlarged, squared

SIDE = 1024
BATCH = 8
"""Prompts a call of the decoder: more need memory and are no faster."""
FEATURES = ("image_embed", "high_res_feats_0", "high_res_feats_1")
ASKED = (*FEATURES, "point_coords", "point_labels", "mask_input", "has_mask_input")
GET = "scripts/fetch_sam, then perceiver.weights=FOLDER (SAM 2 tiny as ONNX, 151 MB)"
LICENCE = "Apache-2.0"


class Sam2Onnx:
    """A :class:`~gvla2.perception.prompting.Segmenter` from a folder with an encoder and a decoder.

    ``sha256`` maps the files' names to what their contents must hash to; what it does not name is not checked.
    Raises :class:`MissingDependencyError` without ONNX Runtime or files, :class:`ConfigurationError` for the files of
    another model.
    """

    def __init__(self, folder: str, sha256: dict[str, str], threads: int) -> None:
        encoder, decoder = model_files(folder)
        for file in (encoder, decoder):
            check_hash(file, sha256.get(file.name, ""))
        self._encoder, self._decoder = _session(str(encoder), threads), _session(str(decoder), threads)
        _check_names(encoder, self._encoder, ("image",), FEATURES)
        _check_names(decoder, self._decoder, ASKED, ("masks", "iou_predictions"))

    def encode(self, image: NDArray[np.uint8]) -> EncodedOnnx:
        """Look at one picture (H, W, 3) RGB."""
        names = [output.name for output in self._encoder.get_outputs()]
        features = self._encoder.run(names, {"image": squared(image, SIDE)[None]})
        return EncodedOnnx(self._decoder, dict(zip(names, features, strict=True)), image.shape[:2])


class EncodedOnnx:
    """A picture's features, ready for prompts."""

    def __init__(self, decoder: Any, features: dict[str, NDArray[np.float32]], size: tuple[int, int]) -> None:
        self._decoder, self._features, self._size = decoder, features, size

    def segment(self, prompts: list[Prompt]) -> Segments:
        """The masks that the prompts mean; K = 0 is allowed."""
        found = [self._batch(prompts[i : i + BATCH]) for i in range(0, len(prompts), BATCH)]
        if not found:
            return Segments(np.zeros((0, 1, *self._size), np.float32), np.zeros((0, 1)))
        return Segments(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _batch(self, prompts: list[Prompt]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        coordinates, labels = encoded(prompts, self._size, SIDE)
        count = len(prompts)
        masks, scores = self._decoder.run(
            ["masks", "iou_predictions"],
            {
                **{name: self._features[name] for name in FEATURES},
                "point_coords": coordinates,
                "point_labels": labels,
                "mask_input": np.zeros((count, 1, SIDE // 4, SIDE // 4), np.float32),
                "has_mask_input": np.zeros(1, np.float32),
            },
        )
        return enlarged(masks, self._size), np.clip(scores.astype(np.float64), 0.0, 1.0)


def encoded(
    prompts: list[Prompt], size: tuple[int, int], side: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points (K, P, 2) in pixels of the square that the picture was stretched to, and their labels (K, P)."""
    stretch = np.array([side / size[1], side / size[0]])
    longest = max(len(p.points) + 2 * (p.box is not None) for p in prompts)
    coordinates = np.zeros((len(prompts), longest, 2), np.float32)
    labels = np.full((len(prompts), longest), -1, np.float32)
    for k, prompt in enumerate(prompts):
        corners = np.zeros((0, 2)) if prompt.box is None else np.array(prompt.box).reshape(2, 2)
        points = np.concatenate([corners, prompt.points.reshape(-1, 2)]) * stretch
        marks = [2, 3][: len(corners)] + [int(p) for p in prompt.positive]
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
        raise MissingDependencyError(what, "perceiver=sam", GET, LICENCE)
    return pair[0][0], pair[1][0]


def check_hash(file: Path, wanted: str) -> None:
    """Raise :class:`ConfigurationError` for a file of other content than its SHA-256 tells; "" is not checked."""
    if not wanted:
        return
    with file.open("rb") as opened:
        actual = hashlib.file_digest(opened, "sha256").hexdigest()
    if actual != wanted.lower():
        raise ConfigurationError(
            f"{file}: its SHA-256 is {actual}, not {wanted} as perceiver.sha256 says: these are other weights, or they "
            "are damaged. Fetch them anew, or set perceiver.sha256={} to use them all the same."
        )


@cache
def _session(path: str, threads: int) -> Any:
    """One a file and process: the weights take hundreds of megabytes."""
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingDependencyError("onnxruntime", "perceiver=sam", "pip install 'gvla2[sam]'") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = threads, 3
    options.enable_mem_pattern = False  # a second set of buffers: 600 MB that save no time
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # the runtime raises a type of its own for each fault of a file
        raise ConfigurationError(f"{path} is no model that ONNX Runtime can load: {error}") from error


def _check_names(file: Path, session: Any, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    has_in = [value.name for value in session.get_inputs()]
    has_out = [value.name for value in session.get_outputs()]
    lacking = [name for name in inputs if name not in has_in] + [n for n in outputs if n not in has_out]
    if lacking:
        raise ConfigurationError(
            f"{file} is another model than SAM 2's: it lacks {', '.join(lacking)}; it takes {', '.join(has_in)} and "
            f"gives {', '.join(has_out)}. For SAM or MobileSAM checkpoints say perceiver.model=mobile_sam, vit_b, "
            "vit_l or vit_h."
        )
