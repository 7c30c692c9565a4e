"""Conformance of trackers and viewers: two episodes are reported, one of them nearly empty."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from gvla2.episode.record import EpisodeRecord
from gvla2.record.tracker import TrackedRun, Tracker, Viewer
from gvla2.testing.conformance import allowed, require, require_members
from gvla2.testing.inputs import INSTRUCTION, observation, scene


def check_tracker(tracker: Tracker) -> None:
    """Whether the tracker handles a run from begin to end, including one that fails immediately."""
    require_members(tracker, "tracker")
    with tempfile.TemporaryDirectory() as place, allowed("A tracker that gets a run"):
        folder = Path(place)
        (folder / "result.json").write_text("{}")
        config = {"seed": 3, "planner": {"name": "mine", "height": 0.1}, "instruction": None}
        tracker.begin(TrackedRun("a/run", folder, config))
        tracker.episode(0, {"success": 1.0, "seconds/plan": 0.2}, folder)
        tracker.episode(1, {"seconds": 3.0}, folder / "absent")
        tracker.end(well=True)


def check_viewer(viewer: Viewer) -> None:
    """Whether the viewer handles an episode with a scene, and one that ended before; each leaves a file."""
    require_members(viewer, "view")
    blind = EpisodeRecord("run/0", INSTRUCTION, "task", 3, {"robot": "gantry"})
    seen = replace(blind, episode_id="run/1", observation=observation(48), scene=scene())
    for record in (blind, seen):
        with tempfile.TemporaryDirectory() as place, allowed("A viewer that is shown an episode"):
            viewer.show(record, Path(place))
            require(
                any(Path(place).iterdir()),
                "A viewer leaves a file in the episode's folder; this one left none.",
            )
