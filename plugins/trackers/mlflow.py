"""MLflow: one run for each of ours, one step per episode."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mlflow.entities import Metric, Param
from mlflow.tracking import MlflowClient

from gvla2.record.tracker import TrackedRun
from gvla2_plugins.trackers.episode_files import files_of

if TYPE_CHECKING:
    from gvla2_plugins.trackers import MLflowConfig

LONGEST = 500
"""Characters of an option that MLflow's stores take."""


class MLflowTracker:
    """Uses its own client: other MLflow runs in this process are not affected."""

    def __init__(self, config: MLflowConfig) -> None:
        self._config = config
        self._client: MlflowClient | None = None
        self._id = ""

    def begin(self, run: TrackedRun) -> None:
        """Create the experiment if missing, and a run in it."""
        uri = self._config.uri
        if not uri:
            Path("outputs").mkdir(exist_ok=True)
            uri = "sqlite:///outputs/mlflow.db"
        client = MlflowClient(tracking_uri=uri)
        found = client.get_experiment_by_name(self._config.experiment)
        experiment = found.experiment_id if found else client.create_experiment(self._config.experiment)
        self._id = client.create_run(experiment, run_name=run.name).info.run_id
        self._client = client
        options = [Param(key, str(value)[:LONGEST]) for key, value in run.flat().items()]
        for start in range(0, len(options), 100):  # a batch's limit
            client.log_batch(self._id, params=options[start : start + 100])

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """One step of each number, and the episode's files."""
        assert self._client is not None
        now = int(time.time() * 1000)
        self._client.log_batch(
            self._id, metrics=[Metric(name, float(value), now, number) for name, value in measures.items()]
        )
        for file in files_of(folder) if self._config.files else []:
            self._client.log_artifact(self._id, str(file), f"episode_{number:03d}")

    def end(self, *, well: bool) -> None:
        """Close the run."""
        if self._client is not None:
            self._client.set_terminated(self._id, "FINISHED" if well else "FAILED")
