"""TensorBoard's event files, written by tensorboardX: no torch, no TensorFlow."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from tensorboardX import SummaryWriter

from gvla2.record.tracker import TrackedRun

if TYPE_CHECKING:
    from gvla2_plugins.trackers import TensorBoardConfig


class TensorBoardTracker:
    """Each run has a folder of its own below the one given."""

    def __init__(self, config: TensorBoardConfig) -> None:
        self._config = config
        self._writer: SummaryWriter | None = None

    def begin(self, run: TrackedRun) -> None:
        """Open the event file, with the configuration as a table of text."""
        own = Path(self._config.folder) / run.name if self._config.folder else run.folder / "tensorboard"
        self._writer = SummaryWriter(str(own))
        rows = "\n".join(f"| {key} | {str(value).replace('|', '/')} |" for key, value in run.flat().items())
        self._writer.add_text("config", f"| option | value |\n|---|---|\n{rows}")

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """One step of each number, and the last picture."""
        assert self._writer is not None
        for name, value in measures.items():
            self._writer.add_scalar(name, value, number)
        if (folder / "after.png").is_file():
            with Image.open(folder / "after.png") as picture:
                self._writer.add_image("after", np.asarray(picture.convert("RGB")), number, dataformats="HWC")

    def end(self, *, well: bool) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.close()
