"""MLflow and Weights & Biases get a run's numbers without a network, and never stop it."""

import json
import logging
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import gvla2
from gvla2 import Component, ComponentConfig, cli, hookimpl
from gvla2.commands.run import Tracking
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import MissingDependencyError
from gvla2.plugins.registry import load_plugins
from gvla2.record.tracker import TrackedRun
from gvla2_plugins.trackers import MLflowConfig, WandbConfig, gvla2_trackers

BUILD = {component.name: component.build for component in gvla2_trackers()}
WITHOUT_WARNINGS = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
"""These libraries use what others have deprecated."""


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TrackedRun:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs" / "one"
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(json.dumps({"success": True}))
    return TrackedRun("runs/one", folder, {"seed": 3, "planner": {"name": "skill", "lift_height": 0.25}})


def tell(tracker: Any, run: TrackedRun) -> None:
    tracker.begin(run)
    tracker.episode(0, {"success": 1.0, "seconds/plan": 0.5}, run.folder)
    tracker.episode(1, {"success": 0.0, "seconds/plan": 0.7}, run.folder)
    tracker.end(well=True)


@WITHOUT_WARNINGS
def test_mlflow(run: TrackedRun, tmp_path: Path):
    pytest.importorskip("mlflow", reason="pip install 'gvla2[track]'")
    from mlflow.tracking import MlflowClient

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    tell(BUILD["mlflow"](MLflowConfig(uri=uri)), run)
    client = MlflowClient(tracking_uri=uri)
    experiment = client.get_experiment_by_name("gvla2")
    (found,) = client.search_runs([experiment.experiment_id])
    assert found.info.status == "FINISHED"
    assert found.info.run_name == "runs/one"
    assert found.data.params["planner.lift_height"] == "0.25"
    assert [(m.step, m.value) for m in client.get_metric_history(found.info.run_id, "success")] == [
        (0, 1.0),
        (1, 0.0),
    ]
    assert client.list_artifacts(found.info.run_id, "episode_000")[0].path == "episode_000/result.json"


@WITHOUT_WARNINGS
def test_wandb_offline(run: TrackedRun, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("wandb", reason="pip install 'gvla2[track]'")
    monkeypatch.setenv("WANDB_ERROR_REPORTING", "false")
    tell(BUILD["wandb"](WandbConfig(mode="offline")), run)
    (kept,) = run.folder.glob("wandb/offline-run-*/*.wandb")
    # Its service writes on after `finish` has returned; on a busy machine for seconds.
    deadline = time.monotonic() + 60
    while not all(word in kept.read_bytes() for word in (b"lift_height", b"seconds/plan")):
        assert time.monotonic() < deadline, kept.read_bytes()
        time.sleep(0.1)


def test_a_library_that_is_absent_is_named(monkeypatch: pytest.MonkeyPatch):
    for name, config in (("mlflow", MLflowConfig()), ("wandb", WandbConfig())):
        for module in [name, *(m for m in sys.modules if m.startswith(f"{name}."))]:
            monkeypatch.setitem(sys.modules, module, None)
        monkeypatch.delitem(sys.modules, f"gvla2_plugins.trackers.{name}", raising=False)
        with pytest.raises(MissingDependencyError, match=rf"tracker={name} needs {name}.*gvla2\[track\]"):
            BUILD[name](config)


class Failing:
    """Fails at an episode."""

    def __init__(self, config: ComponentConfig | None = None) -> None:
        self.heard: list[str] = []

    def begin(self, run: TrackedRun) -> None:
        self.heard.append(run.name)

    def episode(self, number: int, measures: dict[str, float], folder: Path) -> None:
        self.heard.append("episode")
        raise ConnectionError("no route")

    def end(self, *, well: bool) -> None:
        self.heard.append("end")


def test_a_tracker_that_fails_is_reported_once(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    tracker = Failing()
    record = EpisodeRecord("e", "lift", "t", 0, {})
    with caplog.at_level(logging.WARNING), Tracking(tracker, {"seed": 1}, tmp_path) as tracking:
        tracking.episode(0, record, tmp_path)
        tracking.episode(1, record, tmp_path)
    assert tracker.heard == ["/".join(tmp_path.parts[-2:]), "episode"]
    (warning,) = caplog.messages
    assert warning == "The tracker failed and is no longer used: ConnectionError: no route"


def test_a_tracker_that_would_exit_is_named_and_cannot_write_to_the_terminal(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    class Exits(Failing):
        def begin(self, run: TrackedRun) -> None:
            raise SystemExit("\x1b[31m")

    who = "The tracker 'mine' of plugin 'yours'"
    with (
        caplog.at_level(logging.WARNING),
        Tracking(Exits(), {"seed": 1}, tmp_path, named=lambda kind: who),
    ):
        pass
    (warning,) = caplog.messages
    assert warning.startswith(f"{who} failed and is no longer used: RuntimeError: SystemExit(")
    assert "\x1b" not in warning


def test_a_run_goes_on_without_its_tracker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A real run with a tracker that fails."""
    monkeypatch.chdir(tmp_path)
    plugin = SimpleNamespace(
        gvla2_trackers=hookimpl(lambda: [Component("failing", ComponentConfig, Failing, summary="fails")])
    )
    name = gvla2.register(plugin, "failing")
    try:
        assert "failing" in load_plugins().components("tracker")
        assert cli.main(["run", "tracker=failing", "memory=none", "robot.image_size=64", "quiet=true"]) == 0
    finally:
        gvla2.unregister(name)
    (result,) = tmp_path.glob("outputs/run/*/*/result.json")
    content = json.loads(result.read_text())
    assert content["choices"]["tracker"] == "failing"
    assert content["verdict"] is not None
