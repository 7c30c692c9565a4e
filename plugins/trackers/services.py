"""Trackers of MLflow, Weights & Biases and TensorBoard: one run for each of ours, one step per episode."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.record.tracker import TrackedRun

if TYPE_CHECKING:
    from gvla2_plugins.trackers import MLflowConfig, TensorBoardConfig, WandbConfig

SENT = ("index.html", "result.json", "config.yaml", "after.png", "episode.mp4")
"""Files of an episode that are sent to a service."""

LONGEST = 500
"""Characters of an option that MLflow's stores take."""


def sent_files(folder: Path) -> list[Path]:
    """Those of an episode's files that exist."""
    return [folder / name for name in SENT if (folder / name).is_file()]


class MLflowTracker:
    """Uses its own client: other MLflow runs in this process are not affected."""

    def __init__(self, config: MLflowConfig) -> None:
        import mlflow

        self._config, self._mlflow = config, mlflow
        self._client: Any = None
        self._id = ""

    def begin(self, run: TrackedRun) -> None:
        """Create the experiment if missing, and a run in it."""
        uri = self._config.uri
        if not uri:
            Path("outputs").mkdir(exist_ok=True)
            uri = "sqlite:///outputs/mlflow.db"
        self._client = client = self._mlflow.MlflowClient(tracking_uri=uri)
        found = client.get_experiment_by_name(self._config.experiment)
        experiment = found.experiment_id if found else client.create_experiment(self._config.experiment)
        self._id = client.create_run(experiment, run_name=run.name).info.run_id
        param = self._mlflow.entities.Param
        options = [param(key, str(value)[:LONGEST]) for key, value in run.flat().items()]
        for start in range(0, len(options), 100):  # a batch's limit
            client.log_batch(self._id, params=options[start : start + 100])

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """One step of each number, and the episode's files."""
        metric, now = self._mlflow.entities.Metric, int(time.time() * 1000)
        metrics = [metric(name, float(value), now, number) for name, value in measures.items()]
        self._client.log_batch(self._id, metrics=metrics)
        for file in sent_files(folder) if self._config.files else []:
            self._client.log_artifact(self._id, str(file), f"episode_{number:03d}")

    def end(self, *, well: bool) -> None:
        """Close the run."""
        if self._client is not None:
            self._client.set_terminated(self._id, "FINISHED" if well else "FAILED")


class WandbTracker:
    """Its own files go to the run's folder, so that `wandb sync` finds offline files."""

    def __init__(self, config: WandbConfig) -> None:
        import wandb

        self._config, self._wandb = config, wandb
        self._run: Any = None

    def begin(self, run: TrackedRun) -> None:
        """Start a run."""
        self._run = self._wandb.init(
            project=self._config.project,
            entity=self._config.entity or None,
            name=run.name,
            dir=str(run.folder),
            config=dict(run.config),
            mode=self._config.mode or None,  # type: ignore[arg-type, unused-ignore]
            reinit="create_new",
            settings=self._wandb.Settings(silent=True),
        )

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """One step, with the last picture, and the episode's files."""
        values: dict[str, Any] = dict(measures)
        if (folder / "after.png").is_file():
            values["after"] = self._wandb.Image(str(folder / "after.png"))
        self._run.log(values, step=number)
        for file in sent_files(folder) if self._config.files else []:
            self._run.save(str(file), base_path=str(folder.parent), policy="now")

    def end(self, *, well: bool) -> None:
        """Close the run."""
        if self._run is not None:
            self._run.finish(exit_code=0 if well else 1)


class TensorBoardTracker:
    """Event files by tensorboardX (no torch, no TensorFlow); each run has its own folder below the one given."""

    def __init__(self, config: TensorBoardConfig) -> None:
        import tensorboardX

        self._config, self._library = config, tensorboardX
        self._writer: Any = None

    def begin(self, run: TrackedRun) -> None:
        """Open the event file, with the configuration as a table of text."""
        own = Path(self._config.folder) / run.name if self._config.folder else run.folder / "tensorboard"
        self._writer = self._library.SummaryWriter(str(own))
        rows = "\n".join(f"| {key} | {str(value).replace('|', '/')} |" for key, value in run.flat().items())
        self._writer.add_text("config", f"| option | value |\n|---|---|\n{rows}")

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """One step of each number, and the last picture."""
        import numpy as np
        from PIL import Image

        for name, value in measures.items():
            self._writer.add_scalar(name, value, number)
        if (folder / "after.png").is_file():
            with Image.open(folder / "after.png") as picture:
                self._writer.add_image("after", np.asarray(picture.convert("RGB")), number, dataformats="HWC")

    def end(self, *, well: bool) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.close()
