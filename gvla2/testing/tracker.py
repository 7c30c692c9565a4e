"""Conformance of trackers: a run of two episodes is told, the second without anything to show."""

from __future__ import annotations

import tempfile
from pathlib import Path

from gvla2.record.tracker import TrackedRun, Tracker
from gvla2.testing.conformance import allowed, require_members


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
