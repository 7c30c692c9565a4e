import json
import logging
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.errors import OutputError
from gvla2.memory.contracts import Verdict
from gvla2.record import recorder as recorder_module
from gvla2.record.page import render_page
from gvla2.record.pictures import SHOWN, Pictures
from gvla2.record.recorder import STAGE_FILES, RunRecorder
from tests.record.conftest import FILLED

RESULT_KEYS = {
    "command", "success", "success_strict", "task", "seed", "instruction", "robot", "planner", "perceiver", "memory",
    "failure", "timings",
}  # fmt: skip
BETWEEN = (
    ("observe", {"before.png"}, {"scene.json", "perception.png"}),
    ("perceive", {"scene.json", "perception.png"}, {"plan.json", "recalled.json"}),
    ("plan", {"recalled.json", "plan.json", "trajectory.json", "plan.png"}, {"checks.json", "report.json"}),
    ("execute", {"checks.json", "report.json", "after.png"}, {"verdict.json", "index.html"}),
)
"""Stages, what is in the folder after each, and what is not yet."""


def load(path: Path) -> dict[str, object]:
    loaded: dict[str, object] = json.loads(path.read_text(encoding="utf-8"))
    return loaded


def run(
    recorder: RunRecorder, full: EpisodeRecord, after_stage: Callable[[str], None] = lambda stage: None
) -> EpisodeRecord:
    """Play the stages of a finished record; ``after_stage`` is called when a stage's files are written."""
    record = replace(full, **{n: None for names in FILLED.values() for n in names})
    for stage, names in FILLED.items():
        record = replace(record, **{name: getattr(full, name) for name in names})
        for k in range(5 if stage == "execute" else 0):
            recorder.frame(np.full((16, 16, 3), 40 * k, dtype=np.uint8))
        recorder.stage(record, stage)
        recorder.settle()
        after_stage(stage)
    return record


def test_a_finished_run_leaves_everything_and_an_interrupted_one_is_complete_up_to_there(
    tmp_path: Path, episode: Callable[..., EpisodeRecord]
) -> None:
    left: dict[str, set[str]] = {}

    def look(stage: str) -> None:
        left[stage] = {path.name for path in (tmp_path / "out").iterdir()}

    recorder = RunRecorder(tmp_path / "out", "seed: 3\n", "run")
    page = recorder.finish(run(recorder, episode(), look))
    for stage, there, missing in BETWEEN:
        assert left[stage] >= there | {"result.json", "config.yaml"}
        assert not left[stage] & missing
    assert page == tmp_path / "out" / "index.html"
    names = {p.name for p in page.parent.iterdir()}
    assert names == {
        "config.yaml", "result.json", "scene.json", "recalled.json", "plan.json", "trajectory.json", "checks.json",
        "report.json", "scene_after.json", "verdict.json", "learned.json", "perception.png", "plan.png",
        "before.png", "after.png", "refined.png", "episode.mp4", "scene.glb", "views", "index.html",
    }  # fmt: skip
    result = load(page.parent / "result.json")
    assert set(result) >= RESULT_KEYS
    assert (result["command"], result["success"], result["success_strict"]) == ("run", True, False)
    assert result["notes"] == []
    trajectory = load(page.parent / "trajectory.json")
    assert np.array(trajectory["tau"]).shape == (6, 4)
    assert len(trajectory["waypoints"]) == 6  # type: ignore[arg-type]
    html = page.read_text(encoding="utf-8")
    assert html.count("data:image/png") >= 9
    assert "data:video/mp4" in html
    assert 'href="trajectory.json"' in html


def test_a_refined_scene_and_a_second_plan_replace_the_first(
    tmp_path: Path, episode: Callable[..., EpisodeRecord]
) -> None:
    recorder, record = RunRecorder(tmp_path, ""), episode()
    assert record.scene is not None
    assert record.plan is not None
    assert record.plan.trajectory is not None
    recorder.stage(record, "plan")
    recorder.settle()
    before = (tmp_path / "perception.png").read_bytes(), (tmp_path / "plan.png").read_bytes()
    shorter = replace(record.plan.trajectory, waypoints=record.plan.trajectory.waypoints[:3])
    grown = replace(record.scene.objects[0], extents=record.scene.objects[0].extents * 1.5)
    changed = replace(
        record, scene=record.scene.with_object(grown), plan=replace(record.plan, trajectory=shorter)
    )
    recorder.stage(changed, "check")
    recorder.finish(changed)
    assert len(load(tmp_path / "trajectory.json")["waypoints"]) == 3  # type: ignore[arg-type]
    assert (tmp_path / "perception.png").read_bytes() != before[0]
    assert (tmp_path / "plan.png").read_bytes() != before[1]


def test_less_can_be_kept(tmp_path: Path, episode: Callable[..., EpisodeRecord]) -> None:
    kept = {}
    for keep in ("none", "light"):
        recorder = RunRecorder(tmp_path / keep, "", keep=keep)
        recorder.finish(run(recorder, episode()))
        kept[keep] = {path.name for path in (tmp_path / keep).iterdir()}
        assert load(tmp_path / keep / "result.json")["success"] is True
    assert kept["none"] == {"config.yaml", "result.json"}
    assert {"index.html", "before.png", "plan.json"} <= kept["light"]
    assert not kept["light"] & {"episode.mp4", "scene.glb", "views"}


def test_nothing_of_an_earlier_run_in_the_folder_looks_like_this_ones(
    tmp_path: Path, episode: Callable[..., EpisodeRecord], abstained: EpisodeRecord
) -> None:
    first = RunRecorder(tmp_path, "x: 1\n")
    first.finish(run(first, episode()))
    (tmp_path / "mine.txt").touch()
    assert {"report.json", "after.png", "episode.mp4"} <= {path.name for path in tmp_path.iterdir()}
    RunRecorder(tmp_path, "x: 2\n").finish(abstained)
    left = {path.name for path in tmp_path.iterdir()}
    assert "mine.txt" in left
    assert not left & {"report.json", "trajectory.json", "after.png", "episode.mp4"}


def test_failed_and_abstained_runs_leave_a_page(
    tmp_path: Path, failed_at: Callable[[str], EpisodeRecord], abstained: EpisodeRecord
) -> None:
    for stage in ("setup", "perceive", "learn"):  # with nothing, with one look, with everything but its own
        page = RunRecorder(tmp_path / stage, "").finish(failed_at(stage))
        assert f"The stage {stage} broke." in page.read_text(encoding="utf-8")
        assert load(page.parent / "result.json")["failure"] == {
            "stage": stage, "kind": "error", "message": f"The stage {stage} broke.",
        }  # fmt: skip
    page = RunRecorder(tmp_path / "abstained", "").finish(abstained)
    assert load(page.parent / "result.json")["success"] is None
    assert not (page.parent / "trajectory.json").exists()
    assert not (page.parent / "episode.mp4").exists()


def test_a_failing_picture_costs_a_note_not_the_result(
    tmp_path: Path,
    episode: Callable[..., EpisodeRecord],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def broken(*_: object) -> bytes:
        raise ZeroDivisionError("no ink")

    monkeypatch.setitem(recorder_module.SHOWN, "objects", SHOWN["objects"]._replace(make=broken))
    recorder = RunRecorder(tmp_path, "")
    with caplog.at_level(logging.WARNING):
        page = recorder.finish(run(recorder, episode()))
    note = "The picture of the objects could not be made: ZeroDivisionError: no ink"
    assert load(tmp_path / "result.json")["notes"] == [note]
    assert note in caplog.text
    assert note in page.read_text(encoding="utf-8")
    assert not (tmp_path / "perception.png").exists()
    assert (tmp_path / "plan.png").exists()


def test_a_bad_frame_never_stops_the_robot(tmp_path: Path, failed_at: Callable[[str], EpisodeRecord]) -> None:
    recorder = RunRecorder(tmp_path, "")
    recorder.frame(np.zeros((0, 0, 3), dtype=np.uint8))
    recorder.frame("not a picture")  # type: ignore[arg-type]
    recorder.frame(np.zeros((8, 8, 3), dtype=np.uint8))
    recorder.finish(failed_at("setup"))
    assert (tmp_path / "index.html").exists()


def test_a_disk_that_fills_up_raises(
    tmp_path: Path, episode: Callable[..., EpisodeRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = RunRecorder(tmp_path, "")

    def full(prefix: str, dir: Path) -> tuple[int, str]:
        return os.open("/dev/full", os.O_WRONLY), str(dir / f"{prefix}aside")

    monkeypatch.setattr("tempfile.mkstemp", full)
    with pytest.raises(OutputError, match="No space left"):
        recorder.stage(episode(), "learn")


def test_earlier_attempts_are_in_the_result_in_a_file_and_on_the_page(episode):
    first = episode(
        verdict=Verdict.from_criteria({"theme_at_goal": 0.0}, ("The cube is elsewhere.",), "geometric"),
        failure=Failure("verify", "not_achieved", "The cube is <b>elsewhere</b>."),
        success_check=None,
        learned=None,
        timings={"plan": 2.0, "execute": 3.0},
    )
    once, twice = episode(), episode(attempts=(first,), timings={"plan": 1.0, "execute": 2.5})
    attempts = twice.result("run")["attempts"]
    assert [a["verdict"] for a in attempts] == ["verified_fail", "verified_success"]
    assert [a["timings"]["plan"] for a in attempts] == [2.0, 1.0]
    assert twice.seconds == 8.5
    (kept,) = STAGE_FILES["attempts.json"](twice)
    assert len(kept["trajectory"]["waypoints"]) == kept["plan"]["waypoints"] == 6
    assert kept["verdict"]["outcome"] == "verified_fail"
    assert STAGE_FILES["attempts.json"](once) is None
    page = render_page(twice, Pictures())
    assert 'id="attempts"' in page
    assert "&lt;b&gt;elsewhere" in page
    assert 'id="attempts"' not in render_page(once, Pictures())
