"""Episodes as recordings of rerun, read back by rerun itself, and a run that goes on without its viewer."""

import logging
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gvla2.commands.run import Tracking
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import MissingDependencyError
from gvla2.planning.contracts import Plan
from gvla2.planning.findings import CheckReport, Finding
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.record.motion import Motion
from gvla2.robot.backend import Moment
from gvla2.testing.inputs import INSTRUCTION, TABLE, observation, scene
from gvla2_plugins.rerun_view import RerunConfig, gvla2_views

# imageio-ffmpeg leaves the pipe to its reading process to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")

(RERUN,) = gvla2_views()


def record() -> EpisodeRecord:
    path = Trajectory(
        (Waypoint((0.3, 0.0, TABLE + 0.2), 1.0, "approach"), Waypoint((0.3, 0.0, TABLE), 0.0, "grasp"))
    )
    return EpisodeRecord(
        "2025-01-01/12-00-00",
        INSTRUCTION,
        "pick_and_lift",
        3,
        {"robot": "gantry"},
        observation=observation(48),
        scene=scene(),
        plan=Plan(path, skill="pick"),
        checks=CheckReport((Finding("clearance", False, 1, "collision", "Too near | the table."),)),
        after=observation(48),
        after_scene=scene(),
    )


def film(folder: Path, frames: int = 5) -> None:
    motion = Motion(folder)
    for k in range(frames):
        motion.moment(Moment(7.0 + 0.2 * k, np.full(3, 0.1 * k), 0.08))
        motion.frame(np.full((32, 32, 3), 30 * k, np.uint8))
    motion.finish()


def test_a_recording_opens_again(tmp_path: Path):
    pytest.importorskip("rerun", reason="170 MB: pip install 'gvla2[view]'")
    from rerun.chunk import RrdReader

    film(tmp_path)
    RERUN.build(RerunConfig()).show(record(), tmp_path)
    reader = RrdReader(tmp_path / "episode.rrd")
    assert len(reader.recordings()) == 1
    chunks = list(reader.stream())
    paths = {chunk.entity_path for chunk in chunks}
    camera = next(iter(observation(48).views)).name
    assert paths >= {
        "/world", "/world/seen", f"/world/cameras/{camera}", f"/world/cameras/{camera}/image",
        f"/world/cameras/{camera}/depth", "/world/objects/red_cube/body", "/world/objects/red_cube/box",
        "/world/plan/path", "/world/plan/waypoints", "/arm/joints/0", "/arm/joints/2", "/arm/gripper_width",
        "/film",
    }  # fmt: skip
    whole = "\n".join(str(chunk.to_record_batch().to_pydict()) for chunk in chunks)
    assert "red cube" in whole
    assert "0 approach" in whole
    (joint,) = (chunk for chunk in chunks if chunk.entity_path == "/arm/joints/2")
    columns = joint.to_record_batch().to_pydict()
    np.testing.assert_allclose(np.ravel(columns["Scalars:scalars"]), 0.1 * np.arange(5))
    seconds = [moment.total_seconds() for moment in columns["episode"]]
    np.testing.assert_allclose(seconds, 0.2 * np.arange(5), atol=1e-6)


def test_a_library_that_is_absent_is_named(monkeypatch: pytest.MonkeyPatch):
    for module in ["rerun", *(m for m in sys.modules if m.startswith("rerun."))]:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, "gvla2_plugins.rerun_view.recording", raising=False)
    with pytest.raises(MissingDependencyError, match=r"view=rerun needs rerun.*gvla2\[view\]"):
        RERUN.build(RerunConfig())


class Failing:
    def __init__(self) -> None:
        self.shown: list[str] = []

    def show(self, record: EpisodeRecord, folder: Path) -> None:
        self.shown.append(record.episode_id)
        raise ConnectionError("no window")


def test_a_viewer_that_fails_is_dropped_and_reported_once(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    viewer, episode = Failing(), replace(record(), episode_id="one")
    with caplog.at_level(logging.WARNING), Tracking(None, {"seed": 1}, tmp_path, viewer) as tracking:
        tracking.episode(0, episode, tmp_path)
        tracking.episode(1, episode, tmp_path)
    assert viewer.shown == ["one"]
    (warning,) = caplog.messages
    assert warning == "The view failed and is no longer used: ConnectionError: no window"
