"""A sweep of ``gvla2 run``: a bank for each job, finished jobs, and the table at the end.

Each job leaves ``job.json`` in its folder. The process that launched the sweep makes the table from these, whichever
launcher ran the jobs and however the sweep ended.
"""

from __future__ import annotations

import hashlib
import json
import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

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
_MEASURES = ("episodes", "succeeded", "succeeded_strict", "seconds", "tokens", "memory_unavailable")
_STOPPED = (130, 143)
"""Exit statuses of a sweep that was stopped, and would have gone on."""
_NOT_OF_THE_RESULT = ("quiet", "results", "tracker", "view")


class SweepFolder(Callback):
    """Hydra's callback: remembers the folder of the sweep that this process launches."""

    latest: ClassVar[Path | None] = None

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """Called by Hydra before it launches a sweep."""
        type(self).latest = Path(str(config.hydra.sweep.dir)).absolute()


def in_sweep() -> bool:
    """Whether Hydra runs this as a job of a sweep."""
    return HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN


def job_label() -> str:
    """The job's name on the terminal: its number and overrides, as they were typed; "" outside a sweep."""
    if not in_sweep():
        return ""
    hydra = HydraConfig.get()
    return f"[{hydra.job.num}: {', '.join(hydra.overrides.task)}]"


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


def done_before(folder: Path, digest: str) -> float | None:
    """The success rate of a job that finished in this folder with this configuration; None if there is none, or its
    memory was unavailable.
    """
    row = _read(folder / JOB)
    if row.get("status") != "ok" or row.get("digest") != digest or row.get("memory_unavailable"):
        return None
    return float(row["succeeded"]) / row["episodes"] if row.get("episodes") else None


def write_job(folder: Path, config: RunConfig, digest: str, records: Sequence[EpisodeRecord]) -> None:
    """Write what the sweep's table needs from this finished job."""
    measured, checks = [measures_of(r) for r in records], [r.success_check for r in records]
    row = {
        **_job(),
        "status": "ok",
        "digest": digest,
        "results": config.results.url,
        "episodes": len(records),
        "succeeded": sum(one.get("success", 0.0) for one in measured),
        "succeeded_strict": sum(one.get("success_strict", 0.0) for one in measured),
        "seconds": round(sum(one["seconds"] for one in measured), 3),
        "tokens": sum(one.get("tokens", 0) for one in measured),
        "memory_unavailable": sum(bool(record.memory_unavailable) for record in records),
        "layouts": [
            [record.seed, bool(done and done.relaxed), bool(done and done.strict)]
            for record, done in zip(records, checks, strict=True)
        ],
    }
    write_json(folder / JOB, row)


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


def write_failure(folder: Path, config: RunConfig, error: Exception) -> None:
    """Write for the sweep's table why this job failed."""
    refused = isinstance(error, ConfigurationError)
    row = {"status": f"failed: {error}", "refused": refused, "results": config.results.url}
    write_json(folder / JOB, {**_job(), **row})


def _job() -> dict[str, Any]:
    """The job's number and its overrides."""
    hydra = HydraConfig.get()
    given = OverridesParser.create().parse_overrides(list(hydra.overrides.task))
    return {"job": hydra.job.num, "overrides": {one.key_or_group: _as_text(one) for one in given}}


def _as_text(override: Override) -> str:
    value = override.value()
    return value if isinstance(value, str) else override.get_value_element_as_str()


def conclude(status: int, argv: Sequence[str]) -> int:
    """After a sweep: its table on the terminal, as a page, as CSV and in the results database; the exit status.

    Does nothing outside a sweep. After an incomplete sweep it prints how to resume, unless its configuration is wrong.
    """
    folder, SweepFolder.latest = SweepFolder.latest, None
    if folder is None:
        return status
    rows = read_jobs(folder)
    try:
        if rows:
            publish_jobs(folder, rows)
    except Gvla2Error as error:
        print(f"gvla2: the table of the sweep could not be made: {printable(str(error))}", file=sys.stderr)
        status = status or 1
    broken = any(row.get("status") != "ok" and not row.get("refused") for _, row in rows)
    if status in _STOPPED or (status and broken):
        words = [word for word in argv if not word.startswith("hydra.sweep.dir=")]
        command = shlex.join(["gvla2", "run", *words, f"hydra.sweep.dir={folder}"])
        print(f"gvla2: finished jobs are kept. To resume: {printable(command)}", file=sys.stderr)
    return status


def read_jobs(folder: Path) -> list[tuple[Path, Mapping[str, Any]]]:
    """The jobs of a sweep by number: their folders, and what they left; without files that no job wrote."""
    rows = [(file.parent, _read(file)) for file in folder.glob(f"*/{JOB}")]
    return sorted(((place, row) for place, row in rows if row), key=lambda each: each[1]["job"])


def publish_jobs(folder: Path, rows: Sequence[tuple[Path, Mapping[str, Any]]]) -> None:
    """Make the table of a sweep's jobs in every format, and keep them in the results database."""
    from gvla2.commands.report import publish
    from gvla2.evaluation.results import Cell, Results, cell_key
    from gvla2.evaluation.sweeps import SUITE

    cells = [
        Cell(
            cell_key(SUITE, str(place)),
            {"job": row["job"], **row["overrides"]},
            {name: float(row.get(name, 0)) for name in _MEASURES},
            {"status": row["status"], "folder": str(place), "layouts": row.get("layouts")},
        )
        for place, row in rows
    ]
    with Results.open(str(rows[0][1]["results"])) as results:
        before = [run for run in results.runs(SUITE) if run.folder == str(folder)]
        number = before[0].id if before else None
        if number is None:
            files = [place / "config.yaml" for place, _ in rows]
            config = next((file.read_text(encoding="utf-8") for file in files if file.is_file()), "")
            number = results.begin(SUITE, folder, config)
        results.add(number, SUITE, cells)
        stored = results.cells(SUITE, runs=[number])
        stored = sorted(stored, key=lambda cell: int(cell.factors["job"]))
        runs = results.runs(SUITE)
    for file in publish(stored, runs, SUITE, folder, ("terminal", "csv", "html")):
        print(f"{file.suffix[1:]}: {file}")


def _read(file: Path) -> dict[str, Any]:
    """What a job left, checked; empty where there is no file, or one that no job wrote."""
    try:
        with reading("a job", file):
            row: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            numbers = [row["job"], *(row.get(name, 0) for name in _MEASURES)]
            layouts = [(int(seed), bool(done), bool(strict)) for seed, done, strict in row.get("layouts", ())]
            if not all(map(math.isfinite, numbers)):
                raise ValueError("its numbers are not finite.")
            texts = {name: str(row[name]) for name in ("status", "results")}
            return {**row, **texts, "overrides": dict(row["overrides"]), "layouts": layouts}
    except GeometryError:
        return {}
