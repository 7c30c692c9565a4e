"""Promptable segmentation models: SAM 2 through ONNX Runtime, SAM and MobileSAM checkpoints by kornia."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.perception.clicks import Prompt, Segments

MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
"""Of ImageNet's pixels, by which all models of the family were trained."""


def squared(image: NDArray[np.uint8], side: int) -> NDArray[np.float32]:
    """(3, side, side) float32: the picture (H, W, 3) stretched to a square and normalised."""
    grown = Image.fromarray(image).resize((side, side), Image.Resampling.BILINEAR)
    return np.ascontiguousarray(
        ((np.asarray(grown) / 255.0 - MEAN) / DEVIATION).transpose(2, 0, 1), dtype=np.float32
    )


def enlarged(masks: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Logits (K, C, h, w) at another size (H, W), bilinear."""
    if masks.shape[2:] == tuple(size):
        return masks
    flat = masks.reshape(-1, *masks.shape[2:])
    grown = [np.asarray(Image.fromarray(m).resize(size[::-1], Image.Resampling.BILINEAR)) for m in flat]
    return np.array(grown, dtype=np.float32).reshape(*masks.shape[:2], *size)


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
        from kornia.models.sam import Sam, SamConfig
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
    """A :class:`~gvla2.perception.clicks.Segmenter` about a ``kornia.models.sam.Sam``; ``side`` is its input's."""

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


BATCH = 8
"""Prompts a call of the decoder: more need memory and are no faster."""
FEATURES = ("image_embed", "high_res_feats_0", "high_res_feats_1")
ASKED = (*FEATURES, "point_coords", "point_labels", "mask_input", "has_mask_input")
GET_ONNX = "scripts/fetch_sam, then perceiver.weights=FOLDER (SAM 2 tiny as ONNX, 151 MB)"


class Sam2Onnx:
    """A :class:`~gvla2.perception.clicks.Segmenter` from a folder with an encoder and a decoder.

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
        raise MissingDependencyError(what, "perceiver=sam", GET_ONNX, LICENCE)
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
