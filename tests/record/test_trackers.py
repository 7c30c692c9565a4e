"""A tracker that fails never stops the run."""

import json
import logging
from pathlib import Path
from types import SimpleNamespace

import pytest

import gvla2
from gvla2 import Component, ComponentConfig, cli, hookimpl
from gvla2.commands.run import Tracking
from gvla2.episode.record import EpisodeRecord
from gvla2.plugins.registry import load_plugins
from gvla2.record.tracker import TrackedRun


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


class Exits(Failing):
    """Ends the process, in red, when a run begins."""

    def begin(self, run: TrackedRun) -> None:
        raise SystemExit("\x1b[31m")


@pytest.mark.parametrize(
    ("kind", "why"), [(Failing, "ConnectionError: no route"), (Exits, "RuntimeError: SystemExit(")]
)
def test_a_tracker_that_fails_or_would_exit_is_named_once(
    kind: type[Failing], why: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    tracker, who = kind(), "The tracker 'mine' of plugin 'yours'"
    record = EpisodeRecord("e", "lift", "t", 0, {})
    reports = Tracking(tracker, {"seed": 1}, tmp_path, named=lambda kind: who)
    with caplog.at_level(logging.WARNING), reports as tracking:
        tracking.episode(0, record, tmp_path)
        tracking.episode(1, record, tmp_path)
    assert tracker.heard == (["/".join(tmp_path.parts[-2:]), "episode"] if kind is Failing else [])
    (warning,) = caplog.messages
    assert warning.startswith(f"{who} failed and is no longer used: {why}")
    assert "\x1b" not in warning, "nor can it write to the terminal"


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
