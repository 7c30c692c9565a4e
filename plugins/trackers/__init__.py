"""Runs reported to MLflow or Weights & Biases: ``gvla2 run tracker=mlflow``. Off by default.

A run of ours is one run of the service, an episode one step.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import MissingDependencyError

if TYPE_CHECKING:
    from gvla2.record.tracker import TrackedRun, Tracker

SENT = ("index.html", "result.json", "config.yaml", "after.png", "episode.mp4")
"""Files of an episode that are sent to a service."""
LONGEST = 500
"""Characters of an option that MLflow's stores take."""


def _load(package: str, tracker: str, licence: str) -> Any:
    try:
        return import_module(package)
    except ImportError as error:
        install = "pip install 'gvla2[track]'"
        raise MissingDependencyError(package, f"tracker={tracker}", install, licence) from error


def sent_files(folder: Path) -> list[Path]:
    """The files of :data:`SENT` that the episode left."""
    return [folder / name for name in SENT if (folder / name).is_file()]


@dataclass
class MLflowConfig(ComponentConfig):
    """Options of ``mlflow``: ``uri`` of a server, "" for the file ``outputs/mlflow.db``; the ``experiment``'s name.

    ``files`` sends each episode's page, result and picture as well; without a server they come into ``mlruns``.
    """

    uri: str = ""
    experiment: str = "gvla2"
    files: bool = True


class MLflowTracker:
    """Reports to MLflow: configuration, numbers of each episode, pages.

    It uses its own client: other MLflow runs in this process are not affected.
    """

    def __init__(self, config: MLflowConfig) -> None:
        self._config, self._mlflow = config, _load("mlflow", "mlflow", "Apache-2.0")
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


@dataclass
class WandbConfig(ComponentConfig):
    """Options of ``wandb``: ``project`` and ``entity`` ("" for your own); ``mode`` is online, offline or disabled, ""
    for what ``WANDB_MODE`` says.

    ``files`` sends each episode's page, result and picture as well.
    """

    project: str = "gvla2"
    entity: str = ""
    mode: str = ""
    files: bool = True


class WandbTracker:
    """Reports to Weights & Biases: configuration, numbers of each episode, pages.

    Its own files go to the run's folder, so that `wandb sync` finds offline files.
    """

    def __init__(self, config: WandbConfig) -> None:
        self._config, self._wandb = config, _load("wandb", "wandb", "MIT")
        self._run: Any = None

    def begin(self, run: TrackedRun) -> None:
        """Start a run."""
        self._run = self._wandb.init(
            project=self._config.project,
            entity=self._config.entity or None,
            name=run.name,
            dir=str(run.folder),
            config=dict(run.config),
            mode=self._config.mode or None,
            reinit="create_new",
            settings=self._wandb.Settings(silent=True),
        )

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """One step, with the last picture, and the episode's files."""
        picture = folder / "after.png"
        last = {"after": self._wandb.Image(str(picture))} if picture.is_file() else {}
        self._run.log({**measures, **last}, step=number)
        for file in sent_files(folder) if self._config.files else []:
            self._run.save(str(file), base_path=str(folder.parent), policy="now")

    def end(self, *, well: bool) -> None:
        """Close the run."""
        if self._run is not None:
            self._run.finish(exit_code=0 if well else 1)


@hookimpl
def gvla2_trackers() -> list[Component[Tracker]]:
    """``tracker=mlflow`` and ``tracker=wandb``."""
    return [
        Component("mlflow", MLflowConfig, MLflowTracker),
        Component("wandb", WandbConfig, WandbTracker),
    ]
