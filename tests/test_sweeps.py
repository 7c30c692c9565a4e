"""Sweeps of `gvla2 run`: labels, banks, the table at the end, going on where one stopped."""

import csv
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gvla2 import cli
from gvla2.commands import run, sweeps
from gvla2.evaluation.results import Cell
from gvla2.evaluation.statistics import wilson_interval
from gvla2.evaluation.sweeps import run_sheets
from tests.quick import QUICK


def cell(job: int, succeeded: int, status: str = "ok", run: int = 1, **factors: str) -> Cell:
    measures = {
        "episodes": 2,
        "succeeded": succeeded,
        "succeeded_strict": 0,
        "seconds": 3.0,
        "tokens": 10 * job,
    }
    layouts = [[2 * job + k, k < succeeded, False] for k in range(2)]
    notes = {"status": status, "folder": f"/f/{job}", "layouts": layouts}
    return Cell(f"{run}-{job}", {"job": job, **factors}, measures, notes, run)


def test_jobs_that_differ_in_their_seed_alone_are_one_row():
    (table,) = run_sheets(
        cell(job, succeeded, memory=memory, seed=str(seed), quiet="true")
        for job, (memory, seed, succeeded) in enumerate(
            [("none", 0, 0), ("none", 1, 1), ("governed", 0, 2), ("governed", 1, 2)]
        )
    )
    rows = {row.label: [c.lines for c in row.cells] for row in table.rows}
    assert list(rows) == ["memory=none", "memory=governed"], "quiet did not vary, seeds are pooled"
    assert rows["memory=none"][0] == ("25", "[5, 70]")
    assert rows["memory=governed"][0] == ("100", "[51, 100]")
    assert [lines[0] for lines in rows["memory=governed"][2:]] == ["4", "3.0", "25", "2"]
    assert table.films[0].caption == "memory=none, seed=0: 0 of 2"
    assert "4 jobs; runs 1" in table.footnote


def test_a_layout_that_two_jobs_ran_counts_once_in_the_interval():
    def with_layouts(job: int, first: int) -> Cell:
        made, layouts = cell(job, 1, seed=str(first)), [[first, True, False], [first + 1, False, False]]
        return replace(made, notes={**made.notes, "layouts": layouts})

    (table,) = run_sheets([with_layouts(0, 0), with_layouts(1, 1)])
    (row,) = table.rows
    low, high = wilson_interval(1.5, 3)  # layout 1 failed once and succeeded once
    assert row.cells[0].lines == ("50", f"[{100 * low:.0f}, {100 * high:.0f}]")
    assert row.cells[2].lines == ("4 of 3 layouts",)
    assert table.title == "Runs: seed varied"


def test_a_failed_job_is_counted_and_measured_nowhere():
    (table,) = run_sheets([cell(0, 2, task="a"), cell(1, 0, "failed: no robot", task="b")])
    rows = {row.label: [c.lines[0] for c in row.cells] for row in table.rows}
    assert rows["task=b"] == [
        "not measured",
        "not measured",
        "0",
        "not measured",
        "not measured",
        "1, 1 failed",
    ]
    assert table.films[1].caption == "task=b: failed: no robot"
    assert "1 of them failed" in table.footnote


SWEEP = ("run", "-m", "seed=0,1", *QUICK)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GVLA2_HOME", str(tmp_path / "home"))
    return tmp_path


def jobs_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(p.read_text()) for p in sorted(folder.glob(f"*/{sweeps.JOB}"))]


def test_a_sweep_ends_in_a_table_and_goes_on_where_it_stopped(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Two real jobs; the second is interrupted, then gone on with."""
    ran: list[int] = []
    real = run.run_episodes

    def stopped(config: Any, *arguments: Any, **options: Any) -> Any:
        ran.append(config.seed)
        if ran == [0, 1]:
            raise KeyboardInterrupt
        return real(config, *arguments, **options)

    monkeypatch.setattr(run, "run_episodes", stopped)
    assert cli.main([*SWEEP, "quiet=true"]) == 130
    output = capsys.readouterr()
    (folder,) = here.glob("outputs/run/*/*-sweep")
    assert [(job["overrides"]["seed"], job["status"]) for job in jobs_of(folder)] == [
        ("0", "ok"),
        ("1", "failed: its process was stopped or died"),
    ]
    again = re.search(r"To resume: gvla2 (.*)", output.err)
    assert again is not None
    assert re.search(r"\[0: .* -> .*index.html", output.err), "quiet=true still says how a job ended"

    assert cli.main(shlex.split(again.group(1))) == 0
    output = capsys.readouterr()
    assert ran == [0, 1, 1], "what was done is not run again"
    assert re.search(r"\[0: .* is done: ", output.err)
    assert "all jobs" in output.out
    rows = list(csv.DictReader((folder / "report.csv").read_text().splitlines()))
    assert [row["seed"] for row in rows] == ["0", "1"]
    assert {row["episodes"] for row in rows} == {"1.0"}
    assert [(Path(row["folder"]) / "index.html").is_file() for row in rows] == [True, True]
    page = (folder / "index.html").read_text()
    assert page.count("episode.mp4") + page.count("before.png") >= 2
    assert len(list(folder.glob("*/memory.db"))) == 2, "each job has a bank of its own"
    assert not (here / "home").exists()

    assert cli.main(["report", "suite=run"]) == 0
    assert "all jobs" in capsys.readouterr().out


def test_a_planner_that_crashes_fails_and_a_memory_that_is_not_there_is_reported(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """The planner crashes in the first of two episodes; the bank's database is none."""
    from gvla2_plugins.skill.planner import SkillPlanner

    real, asked = SkillPlanner.plan, []

    def crash(self: Any, request: Any) -> Any:
        asked.append(request)
        if len(asked) == 1:
            raise KeyError("nowhere")
        return real(self, request)

    monkeypatch.setattr(SkillPlanner, "plan", crash)
    broken = here / "broken.db"
    broken.write_bytes(b"this is no database" * 100)
    sweep = ("run", "-m", "seed=1", "episodes=2", *QUICK, "quiet=true", f"memory.url=sqlite:///{broken}")
    assert cli.main(sweep) == 0
    output = capsys.readouterr()
    (folder,) = here.glob("outputs/run/*/*-sweep")
    (row,) = csv.DictReader((folder / "report.csv").read_text().splitlines())
    assert (row["episodes"], row["succeeded"], row["status"]) == ("2.0", "1.0", "ok")
    assert row["memory_unavailable"] == "2.0"
    assert "all jobs (memory unavailable in 2 of 2)" in " ".join(output.out.split())
    assert "memory unavailable in 2 of 2 episodes: " in output.err
    (result,) = folder.glob("*/result.json")
    failure = json.loads(result.read_text())["rows"][0]["failure"]
    assert (failure["stage"], failure["kind"]) == ("plan", "crashed")


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("memory.bank='a b'", "'a b' cannot be the name of a bank"),
        ("episodes=0", "at least 1"),
    ],
)
def test_no_sweep_of_a_wrong_configuration_is_resumed(
    here: Path, capsys: pytest.CaptureFixture[str], option: str, message: str
):
    assert cli.main(["run", "-m", "seed=0", *QUICK, option]) == 1
    shown = capsys.readouterr()
    assert message in shown.err
    assert "To resume" not in shown.err
    if "memory" in option:  # found by the job, not by the configuration itself
        assert "1 job, 1 of them failed" in " ".join(shown.out.split())


def test_a_bank_that_is_named_is_used(here: Path, compose_run: Any, tmp_path: Path):
    fresh = sweeps.with_fresh_bank(compose_run("memory.url=''"), tmp_path)
    assert fresh.memory.url == f"sqlite:///{tmp_path / 'memory.db'}"
    for named in ("memory.url=sqlite:///mine.db", "memory.bank=lab"):
        config = compose_run("memory.url=''", named)
        assert sweeps.with_fresh_bank(config, tmp_path) is config
    nothing = compose_run("memory=none")
    assert sweeps.with_fresh_bank(nothing, tmp_path) is nothing


def test_a_worker_ends_with_the_sweep_that_is_killed(tmp_path: Path):
    worker = (
        "import os, time; from gvla2.evaluation.engine import end_with_parent; end_with_parent(); "
        "print(os.getpid(), flush=True); time.sleep(100)"
    )
    sweep = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {worker!r}])"
    with subprocess.Popen([sys.executable, "-c", sweep], stdout=subprocess.PIPE, text=True) as killed:
        assert killed.stdout is not None
        pid = int(killed.stdout.readline())
        killed.kill()
        for _ in range(100):
            status = Path(f"/proc/{pid}/stat")
            if not status.exists() or ") Z " in status.read_text():
                return
            time.sleep(0.1)
        os.kill(pid, signal.SIGKILL)
        pytest.fail("the worker lives on")


def test_a_pipe_in_place_of_a_jobs_result_holds_nothing_up(tmp_path: Path):
    os.mkfifo(tmp_path / sweeps.JOB)
    assert sweeps.done_before(tmp_path, "digest") is None


def test_only_a_job_of_the_same_configuration_is_done(compose_run: Any, tmp_path: Path):
    digest = sweeps.digest_of(compose_run("seed=1"))
    row: dict[str, Any] = {"job": 0, "overrides": {}, "results": "", "status": "ok", "digest": digest}
    row |= {"episodes": 4, "succeeded": 3}
    (tmp_path / sweeps.JOB).write_text(json.dumps(row))
    assert sweeps.done_before(tmp_path, sweeps.digest_of(compose_run("seed=1", "quiet=false"))) == 0.75
    assert sweeps.done_before(tmp_path, sweeps.digest_of(compose_run("seed=2"))) is None
    (tmp_path / sweeps.JOB).write_text(json.dumps({**row, "status": "failed: no robot"}))
    assert sweeps.done_before(tmp_path, digest) is None
    (tmp_path / sweeps.JOB).write_text(json.dumps({**row, "memory_unavailable": 1}))
    assert sweeps.done_before(tmp_path, digest) is None, "its memory was not there"
    (tmp_path / sweeps.JOB).write_text("{half")
    assert sweeps.done_before(tmp_path, digest) is None


def test_the_first_line_names_the_bank(compose_run: Any, registry: Any):
    config = compose_run()
    with closing(registry.build(config, "memory")) as memory:
        line = run.bank_line(config, memory)
    assert re.fullmatch(r"memory governed, bank 'default' of sqlite:///.*memory\.db", line)
