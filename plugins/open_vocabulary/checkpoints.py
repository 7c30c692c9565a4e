"""Checkpoints in transformers' own folders: local files only, safetensors only."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gvla2.errors import ConfigurationError, MissingDependencyError

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
