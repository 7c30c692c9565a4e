"""Sweeps of ``gvla2 run`` and ``gvla2 reconstruct``: finished jobs, the time left, and the table at the end.

Each job leaves ``job.json`` in its folder. The process that launched the sweep makes the table from these, whichever
launcher ran the jobs and however the sweep ended.
"""

from __future__ import annotations

import hashlib
import json
import math
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from gvla2.errors import ConfigurationError, GeometryError, Gvla2Error, reading
from gvla2.io.files import write_json
from gvla2.record.text import printable

if TYPE_CHECKING:
    from gvla2.commands.run import RunConfig
    from gvla2.episode.record import EpisodeRecord

JOB = "job.json"
BANK = "memory.db"
_SWEEP, _ENDED = "sweep.json", "ended.txt"
_STOPPED = (130, 143)
"""Exit statuses of a sweep that was stopped, and would have gone on."""
_NOT_OF_THE_RESULT = ("quiet", "record", "results", "tracker", "view")


@dataclass(frozen=True)
class Measured:
    """What a sweep's table needs of one episode or reconstruction: a row of its CSV."""

    factors: Mapping[str, str | int]
    measures: Mapping[str, float]
    notes: Mapping[str, Any]


class SweepFolder(Callback):
    """Hydra's callback: remembers the folder of the sweep that this process launches, and describes it for its jobs."""

    latest: ClassVar[Path | None] = None

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Called by Hydra before it launches a sweep."""
        folder = Path(str(config.hydra.sweep.dir)).absolute()
        type(self).latest = folder
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _ENDED).unlink(missing_ok=True)
        preset = [f"{name}={value}" for name, value in (config.hydra.sweeper.get("params") or {}).items()]
        given = OverridesParser.create().parse_overrides([*preset, *config.hydra.overrides.task])
        same = [
            f"{one.get_key_element()}={one.get_value_element_as_str()}"
            for one in given
            if not one.is_sweep_override()
        ]
        plain = str(config.hydra.sweeper._target_).endswith(BasicSweeper.__name__)
        jobs = len(BasicSweeper.split_arguments(given, None)[0]) if plain else None
        write_json(folder / _SWEEP, {"began": time.time(), "jobs": jobs, "same": same})


def in_sweep() -> bool:
    """Whether Hydra runs this as a job of a sweep."""
    return HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN


def job_label() -> str:
    """The job's name on the terminal: its number and the overrides that differ between jobs; "" outside a sweep."""
    if not in_sweep():
        return ""
    hydra = HydraConfig.get()
    same = _read(Path(hydra.sweep.dir) / _SWEEP).get("same", ())
    varied = ", ".join(one for one in hydra.overrides.task if one not in same)
    return f"[{hydra.job.num}: {varied}]" if varied else f"[{hydra.job.num}]"


def with_fresh_bank(config: RunConfig, folder: Path) -> RunConfig:
    """The configuration with a bank of its own in ``folder``, unless a database or a bank is named."""
    memory: Any = getattr(config, "memory", None)
    default = getattr(type(memory), "bank", None)
    if getattr(memory, "url", None) != "" or getattr(memory, "bank", default) != default:
        return config
    changed: Any = replace(memory, url=f"sqlite:///{(folder / BANK).absolute()}")
    return replace(config, memory=changed)  # type: ignore[call-arg]  # a field that the bridge to Hydra adds


def digest_of(config: RunConfig) -> str:
    """A digest that differs for configurations that may have different results."""
    options: Any = OmegaConf.to_container(OmegaConf.structured(config), enum_to_str=True)
    kept = {key: value for key, value in options.items() if key not in _NOT_OF_THE_RESULT}
    return hashlib.sha256(json.dumps(kept, sort_keys=True, default=str).encode()).hexdigest()


def kept_job(config: Any, folder: Path, run: Callable[[str], tuple[float, Sequence[Measured]]]) -> float:
    """The value of a job for Hydra's sweepers: ``run`` gets the job's label, and returns it with what was measured.

    A job of a sweep is not run again in a folder where it is done.
    """
    if not in_sweep():
        return run("")[0]
    label, digest = job_label(), digest_of(config)
    done = None if config.results.fresh else done_before(folder, digest)
    if done is not None:
        page = folder / "index.html"
        print(f"{label} is done: {page if page.is_file() else folder}", file=sys.stderr)
        _ended("-")
        return done
    for file in folder.glob(f"{BANK}*"):  # what an earlier, unfinished try has learned
        file.unlink()
    # Replaced when the job ends: a process that dies leaves its job named in the sweep's table.
    job = {**_job(), "results": config.results.url}
    write_json(folder / JOB, {**job, "status": "failed: its process was stopped or died"})
    try:
        value, rows = run(label)
    except Exception as error:
        refused = isinstance(error, ConfigurationError)
        write_json(folder / JOB, {**job, "status": f"failed: {error}", "refused": refused})
        _ended("+")
        raise
    made = {"status": "ok", "digest": digest, "value": value, "rows": [vars(row) for row in rows]}
    write_json(folder / JOB, {**job, **made})
    print(f"{label} {_ended('+')}", file=sys.stderr)
    return value


def done_before(folder: Path, digest: str) -> float | None:
    """The value of a job that finished in this folder with this configuration; None if there is none, or its memory was
    unavailable.
    """
    row = _read(folder / JOB)
    if row.get("status") != "ok" or row.get("digest") != digest or "value" not in row:
        return None
    return None if any(one["notes"].get("memory_unavailable") for one in row["rows"]) else float(row["value"])


def _ended(how: str) -> str:
    """Count a job that has run ("+") or was done before ("-"); the sweep's progress and the time left, as text.

    Jobs append one character each to a file, which any number of processes may do at once.
    """
    folder = Path(HydraConfig.get().sweep.dir)
    with (folder / _ENDED).open("a+", encoding="ascii") as file:
        file.write(how)
        file.seek(0)
        ended = file.read()
    sweep = _read(folder / _SWEEP)
    jobs, ran = sweep.get("jobs"), ended.count("+")
    if not jobs or not ran:
        return f"{len(ended)} jobs done"
    left = (time.time() - sweep["began"]) / ran * (jobs - len(ended))
    return f"{len(ended)} of {jobs} jobs done" + (f", about {duration(left)} left" if left > 0 else "")


def duration(seconds: float) -> str:
    """A time as a person says it: 40 s, 12 min, 3.5 h."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def measured(record: EpisodeRecord, folder: Path) -> Measured:
    """An episode in a sweep's table."""
    notes = {
        "folder": str(folder.absolute()),
        "failure": failure_code(record),
        "verdict": record.verdict.outcome if record.verdict else "",
        "memory_unavailable": record.memory_unavailable,
    }
    return Measured({"seed": record.seed}, measures_of(record), notes)


def failure_code(record: EpisodeRecord) -> str:
    """The kind of failure as in ``result.json``; "" for a success."""
    if record.success_check is not None and record.success_check.relaxed:
        return ""
    return record.failure.kind if record.failure is not None else "not_judged"


def measures_of(record: EpisodeRecord) -> dict[str, float]:
    """The numbers of an episode: outcome, seconds of each stage, tokens. Outcomes that nobody judged are left out."""
    found = {f"seconds/{stage}": seconds for stage, seconds in record.timings.items()}
    found |= {"seconds": record.seconds, "attempts": len(record.attempts) + 1}
    if (success := record.success_check) is not None:
        found |= {"success": float(success.relaxed), "success_strict": float(success.strict)}
    if record.verdict is not None:
        found["verified"] = float(record.verdict.outcome == "verified_success")
    if tallies := record.language.values():
        found["tokens"] = sum(t.get("prompt_tokens", 0) + t.get("completion_tokens", 0) for t in tallies)
    return found


def _job() -> dict[str, Any]:
    """The job's number and its overrides."""
    hydra = HydraConfig.get()
    given = OverridesParser.create().parse_overrides(list(hydra.overrides.task))
    return {"job": hydra.job.num, "overrides": {one.key_or_group: _as_text(one) for one in given}}


def _as_text(override: Override) -> str:
    value = override.value()
    return value if isinstance(value, str) else override.get_value_element_as_str()


def conclude(command: str, status: int, argv: Sequence[str]) -> int:
    """After a sweep: its tables on the terminal, as files and in the results database; the exit status.

    Does nothing outside a sweep. After an incomplete sweep it prints how to resume, unless its configuration is wrong.
    """
    folder, SweepFolder.latest = SweepFolder.latest, None
    if folder is None:
        return status
    jobs = read_jobs(folder)
    try:
        if jobs:
            publish_jobs(command, folder, jobs)
    except Gvla2Error as error:
        print(f"gvla2: the table of the sweep could not be made: {printable(str(error))}", file=sys.stderr)
        status = status or 1
    planned = _read(folder / _SWEEP).get("jobs") or 0
    if status and len(jobs) < planned:
        print(f"gvla2: {planned - len(jobs)} of {planned} jobs did not begin.", file=sys.stderr)
    broken = any(job.get("status") != "ok" and not job.get("refused") for _, job in jobs)
    if status in _STOPPED or (status and broken):
        words = [word for word in argv if not word.startswith("hydra.sweep.dir=")]
        again = shlex.join(["gvla2", command, *words, f"hydra.sweep.dir={folder}"])
        print(f"gvla2: finished jobs are kept. To resume: {printable(again)}", file=sys.stderr)
    return status


def read_jobs(folder: Path) -> list[tuple[Path, Mapping[str, Any]]]:
    """The jobs of a sweep by number: their folders, and what they left. A file that no job wrote is left out."""
    jobs = []
    for file in folder.glob(f"*/{JOB}"):
        try:
            with reading("a job", file):
                job = json.loads(file.read_text(encoding="utf-8"))
                rows = [
                    Measured(dict(r["factors"]), dict(r["measures"]), dict(r["notes"]))
                    for r in job.get("rows", ())
                ]
                measures = [value for row in rows for value in row.measures.values() if value is not None]
                if not all(map(math.isfinite, measures)):
                    raise ValueError("its measures are not finite")
                texts = {name: str(job[name]) for name in ("status", "results")}
                whole = {
                    "job": int(job["job"]),
                    "overrides": dict(job["overrides"]),
                    "rows": [vars(r) for r in rows],
                }
                jobs.append((file.parent, {**job, **texts, **whole}))
        except GeometryError as error:
            print(f"gvla2: left out of the table: {printable(str(error))}", file=sys.stderr)
    return sorted(jobs, key=lambda each: each[1]["job"])


def publish_jobs(suite: str, folder: Path, jobs: Sequence[tuple[Path, Mapping[str, Any]]]) -> None:
    """Make the table of a sweep's jobs in every format, and keep them in the results database."""
    from gvla2.commands.report import publish
    from gvla2.evaluation.results import Cell, Results, cell_key

    cells = []
    for place, job in jobs:
        failed = {"factors": {}, "measures": {}, "notes": {"folder": str(place)}}
        for place_in_job, row in enumerate(job.get("rows") or [failed]):
            factors = {"job": job["job"], **job["overrides"], **row["factors"]}
            notes = {"status": job["status"], **row["notes"]}
            cells.append(Cell(cell_key(suite, str(place), place_in_job), factors, row["measures"], notes))
    with Results.open(str(jobs[0][1]["results"])) as results:
        before = [run for run in results.runs(suite) if run.folder == str(folder)]
        number = before[0].id if before else None
        if number is None:
            files = [place / "config.yaml" for place, _ in jobs]
            config = next((file.read_text(encoding="utf-8") for file in files if file.is_file()), "")
            number = results.begin(suite, folder, config)
        results.add(number, suite, cells)
        runs = [run for run in results.runs(suite) if run.id == number]
    made = [replace(cell, run=number) for cell in cells]
    for file in publish(made, runs, suite, folder, ("terminal", "latex", "csv", "html")):
        print(f"{file.suffix[1:]}: {file}")


def _read(file: Path) -> dict[str, Any]:
    if not file.is_file():  # reading a pipe would never end
        return {}
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
