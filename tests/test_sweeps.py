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
from collections.abc import Sequence
from contextlib import closing
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from gvla2 import cli
from gvla2.commands import run, sweeps
from gvla2.evaluation.results import Cell
from gvla2.evaluation.statistics import wilson_interval
from gvla2.evaluation.sweeps import reconstruction_sheets, run_sheets
from gvla2.evaluation.tables import Sheet, render_report, to_csv, to_latex
from tests.quick import QUICK


def cell(job: int, seed: int, failure: str = "", run: int = 1, **factors: str) -> Cell:
    """An episode of a job."""
    measures = {"success": float(not failure), "seconds": 3.0, "seconds/plan": 0.5, "tokens": 10.0 * job}
    notes = {"status": "ok", "folder": f"/f/{job}", "failure": failure, "verdict": "verified_success"}
    return Cell(f"{run}-{job}-{seed}", {"job": job, **factors, "seed": seed}, measures, notes, run)


def pivoted(cells: Sequence[Cell]) -> tuple[dict[str, dict[str, tuple[str, ...]]], list[Sheet]]:
    """The cells of a sweep's two tables by row and column, and the tables."""
    sheets = run_sheets(cells)
    rows: dict[str, dict[str, tuple[str, ...]]] = {}
    for sheet in sheets:
        for row in sheet.rows:
            shown = zip(sheet.headings, (one.lines for one in row.cells), strict=True)
            rows.setdefault(row.label, {}).update(shown)
    return rows, sheets


def test_a_sweep_becomes_a_table_of_what_varied_by_tasks_with_paired_tests():
    """Without memory 8 layouts of ``lift`` fail in two ways; with it all succeed; ``push`` stays as it is."""
    won = {("none", "push"): range(8), ("governed", "push"): range(8), ("governed", "lift"): range(8)}
    cells = [
        cell(
            job,
            seed,
            "" if seed in won.get((memory, task), ()) else why,
            memory=memory,
            task=task,
            quiet="true",
        )
        for job, (memory, task) in enumerate(product(("none", "governed"), ("push", "lift")))
        for seed, why in enumerate(["slipped"] * 3 + ["goal_not_reached"] * 5)
    ]
    rows, (success, costs) = pivoted(cells)
    none, governed = rows["memory=none"], rows["memory=governed"]
    assert list(rows) == ["memory=none", "memory=governed"], "quiet did not vary"
    assert (none["lift"], none["push (saturated)"][0]) == (("0.0", "[0, 32] 0/8"), "100.0")
    assert none["mean"] == ("50.0",)
    assert (governed["lift"][0], governed["mean"]) == ("100.0 *", ("100.0",))
    points, _, counts, _, tasks = governed["against the first row"]
    assert (points, counts, tasks) == ("+50.0 points", "8 : 0 of 16, p 0.00781", "lift +")
    assert (none["slipped"], none["goal_not_reached"], none["episodes"]) == (("3",), ("5",), ("16",))
    assert (governed["slipped"], governed["jobs"]) == (("0",), ("2",))
    assert [film.failed for film in costs.films] == [False] * 8 + [True] * 8 + [False] * 16
    page = render_report([success, costs], [], "a sweep")
    assert page.count('class="failed"') == 8
    latex = to_latex([success])
    assert r"memory=governed & 100.0 {\scriptsize {[}68, 100] 8/8} & 100.0 *" in latex
    assert "McNemar" not in "".join(line for line in latex.splitlines() if not line.startswith("%"))
    header, first, *_ = csv.reader(to_csv(cells).splitlines())
    row = dict(zip(header, first, strict=True))
    assert (row["seconds/plan"], row["failure"], row["verdict"]) == ("0.5", "", "verified_success")


def test_a_layout_that_two_jobs_ran_counts_once_in_the_interval():
    rows, (success, _) = pivoted([cell(0, 0), cell(0, 1, "slipped"), cell(1, 1), cell(1, 2, "slipped")])
    low, high = wilson_interval(1.5, 3)  # layout 1 failed once and succeeded once
    assert rows["all jobs"]["success"] == ("50.0", f"[{100 * low:.0f}, {100 * high:.0f}] 1.5/3")
    assert rows["all jobs"]["episodes"] == ("4",)
    assert success.title == "Runs: seed varied"


def test_a_failed_job_is_counted_and_measured_nowhere():
    broken = Cell("1-1", {"job": 1, "task": "b"}, {}, {"status": "failed: no robot", "folder": "/f/1"}, 1)
    rows, (success, costs) = pivoted([cell(0, 0, task="a"), broken])
    assert (rows["all jobs"]["b"], rows["all jobs"]["mean"]) == (("not measured",), ("100.0",))
    assert (rows["all jobs"]["episodes"], rows["all jobs"]["jobs"]) == (("1",), ("2, 1 failed",))
    assert costs.films[1].caption == "task=b, seed=: failed: no robot"
    assert "1 of them failed" in success.footnote


def test_a_sweep_of_reconstructions_compares_what_varied_over_objects():
    def made(job: int, fusion: str, views: str, distance: float) -> Cell:
        factors = {"job": job, "fusion": fusion, "views": views, "object": views}
        return Cell(
            f"{job}", factors, {"symmetric_iou": 0.9, "cd_surface": distance}, {"folder": f"/f/{job}"}, 1
        )

    jobs = enumerate(product(("none", "blend"), "abcde"))
    (table,) = reconstruction_sheets(
        made(job, fusion, views, 4.0 if fusion == "none" else 2.0) for job, (fusion, views) in jobs
    )
    assert table.headings == ("symmetric IoU ↑", "CD surface ×10³ ↓")
    assert [row.label for row in table.rows] == ["fusion=none", "fusion=blend"]
    assert table.rows[1].cells[1].lines[:2] == ("2.00", "-50.00 % [-50.00, -50.00]")
    assert table.rows[1].cells[1].tone == "better"


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
    assert re.search(r"\[0: seed=0\] -> .*index.html", output.err), "quiet=true still says how a job ended"
    assert "[0: seed=0] 1 of 2 jobs done, about " in output.err

    (page,) = folder.glob("0_*/index.html")
    page.unlink()  # as after record=none
    assert cli.main(shlex.split(again.group(1))) == 0
    output = capsys.readouterr()
    assert ran == [0, 1, 1], "what was done is not run again"
    assert f"is done: {page.parent}\n" in output.err
    assert "all jobs" in output.out
    rows = list(csv.DictReader((folder / "report.csv").read_text().splitlines()))
    assert [row["seed"] for row in rows] == ["0", "1"]
    assert {row["success"] for row in rows} == {"1.0"}
    assert all(float(row["seconds/plan"]) > 0 for row in rows)
    assert [(Path(row["folder"]) / "index.html").is_file() for row in rows] == [False, True]
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
    first, second = csv.DictReader((folder / "report.csv").read_text().splitlines())
    assert (first["success"], first["failure"], second["failure"]) == ("", "crashed", "")
    assert second["success"] == "1.0"
    assert "1 of 2 episodes succeeded, 50 % | 95 % interval 9 to 91 | 1 crashed" in output.err
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
    row: dict[str, Any] = {"status": "ok", "digest": digest, "value": 0.75, "rows": []}
    (tmp_path / sweeps.JOB).write_text(json.dumps(row))
    assert sweeps.done_before(tmp_path, sweeps.digest_of(compose_run("seed=1", "quiet=false"))) == 0.75
    assert sweeps.done_before(tmp_path, sweeps.digest_of(compose_run("seed=2"))) is None
    (tmp_path / sweeps.JOB).write_text(json.dumps({**row, "status": "failed: no robot"}))
    assert sweeps.done_before(tmp_path, digest) is None
    (tmp_path / sweeps.JOB).write_text(
        json.dumps({**row, "rows": [{"notes": {"memory_unavailable": "no database"}}]})
    )
    assert sweeps.done_before(tmp_path, digest) is None, "its memory was not there"
    (tmp_path / sweeps.JOB).write_text("{half")
    assert sweeps.done_before(tmp_path, digest) is None


def test_the_first_line_names_the_bank(compose_run: Any, registry: Any):
    config = compose_run()
    with closing(registry.build(config, "memory")) as memory:
        line = run.bank_line(config, memory)
    assert re.fullmatch(r"memory governed, bank 'default' of sqlite:///.*memory\.db", line)
