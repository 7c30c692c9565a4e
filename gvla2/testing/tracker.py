"""Conformance of trackers and viewers: two episodes are told, one of them with next to nothing to show."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from gvla2.record.contents import EpisodeRecord
from gvla2.record.tracker import TrackedRun, Tracker, Viewer
from gvla2.testing.conformance import allowed, require, require_members
from gvla2.testing.inputs import INSTRUCTION, observation, scene


def check_tracker(tracker: Tracker) -> None:
    """Whether the tracker takes a run from begin to end, also one that ends badly at once."""
    require_members(tracker, "tracker")
    with tempfile.TemporaryDirectory() as place, allowed("A tracker that is told of a run"):
        folder = Path(place)
        (folder / "result.json").write_text("{}")
        config = {"seed": 3, "planner": {"name": "mine", "height": 0.1}, "instruction": None}
        tracker.begin(TrackedRun("a/run", folder, config))
        tracker.episode(0, {"success": 1.0, "seconds/plan": 0.2}, folder)
        tracker.episode(1, {"seconds": 3.0}, folder / "absent")
        tracker.end(well=True)


def check_viewer(viewer: Viewer) -> None:
    """Whether the viewer takes an episode that was seen, and one that ended before; each leaves something."""
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
