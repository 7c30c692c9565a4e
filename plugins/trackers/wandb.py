"""Weights & Biases: one run for each of ours, one step per episode."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import wandb

from gvla2.record.tracker import TrackedRun
from gvla2_plugins.trackers.episode_files import files_of

if TYPE_CHECKING:
    from gvla2_plugins.trackers import WandbConfig


class WandbTracker:
    """Its own files go to the run's folder, so that `wandb sync` finds offline files."""

    def __init__(self, config: WandbConfig) -> None:
        self._config = config
        self._run: Any = None

    def begin(self, run: TrackedRun) -> None:
        """Start a run."""
        self._run = wandb.init(
            project=self._config.project,
            entity=self._config.entity or None,
            name=run.name,
            dir=str(run.folder),
            config=dict(run.config),
            mode=self._config.mode or None,  # type: ignore[arg-type]
            reinit="create_new",
            settings=wandb.Settings(silent=True),
        )

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """One step, with the last picture, and the episode's files."""
        told: dict[str, Any] = dict(measures)
        if (folder / "after.png").is_file():
            told["after"] = wandb.Image(str(folder / "after.png"))
        self._run.log(told, step=number)
        if self._config.files:
            for file in files_of(folder):
                self._run.save(str(file), base_path=str(folder.parent), policy="now")

    def end(self, *, well: bool) -> None:
        """Close the run."""
        if self._run is not None:
            self._run.finish(exit_code=0 if well else 1)
