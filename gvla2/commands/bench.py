"""``gvla2 bench``: measure a suite, and make its table."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from omegaconf import OmegaConf

if TYPE_CHECKING:
    from gvla2.evaluation.config import BenchConfig
    from gvla2.plugins.registry import Registry

log = logging.getLogger(__name__)


def run_bench(config: BenchConfig, registry: Registry, folder: Path) -> float:
    """Run the bench into ``folder``; returns the share of cells that could be measured.

    It leaves ``result.json``, ``index.html``, ``report.md``, ``report.tex``, ``report.csv`` and ``pictures``. Raises
    :class:`ConfigurationError` for a missing data set or component; an object that cannot be measured gives a row with
    a status, not an error.
    """
    from gvla2.commands.report import publish
    from gvla2.evaluation.engine import run_suite
    from gvla2.evaluation.results import Results, code_digest, versions
    from gvla2.evaluation.suites import suite_named
    from gvla2.io.files import make_folder, plain, write_json
    from gvla2.record.origin import origin_of

    suite_class = suite_named(config.suite)
    make_folder(folder)
    with Results.open(config.results.url) as results:
        composed = OmegaConf.to_yaml(OmegaConf.structured(config))
        run_id = results.begin(config.suite, folder, composed, code_digest(("gvla2",)))
        suite = suite_class(config, registry, results, run_id, folder)
        # Rows measured just now have no run yet.
        cells = [cell if cell.run else replace(cell, run=run_id) for cell in run_suite(suite)]
        result = {
            "command": "bench",
            "suite": config.suite,
            "run": run_id,
            "database": results.url,
            "origin": plain(origin_of(config, "bench")),
            "versions": versions(),
            "rows": [{**cell.flat(), "run": cell.run} for cell in cells],
        }
        write_json(folder / "result.json", result)
        used = {cell.run for cell in cells}
        runs = [run for run in results.runs(config.suite) if run.id in used]
        publish(cells, runs, config.suite, folder)
    failed = Counter(cell.status for cell in cells if cell.status != "ok")
    for status, count in failed.items():
        log.warning("%d of %d cells %s", count, len(cells), status)
    if not config.quiet:
        print(f"Report: {folder / 'index.html'}")
    return 1 - sum(failed.values()) / max(len(cells), 1)


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 bench [suite] [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch, suite_schemas
    from gvla2.evaluation.config import BenchConfig

    return launch("bench", {"bench": BenchConfig, **suite_schemas()}, run_bench, as_overrides(argv))


def as_overrides(argv: Sequence[str]) -> list[str]:
    """The arguments in Hydra's terms.

    A leading word, as in ``gvla2 bench robot``, or ``suite=robot`` chooses the suite: the Hydra group ``bench_suite``.
    Options under a task's, baseline's or arm's name (``task_options.open_jar.turn=175``,
    ``arms.mine={memory: governed}``) are new to the configuration, for which Hydra needs a ``+``; custom arms are added
    to the listed ``arms``.
    """
    if argv and re.fullmatch(r"\w+", argv[0]):
        argv = [f"suite={argv[0]}", *argv[1:]]
    argv = [re.sub(r"^suite=", "bench_suite=", one) for one in argv]
    own = dict.fromkeys(match[1] for one in argv if (match := re.match(r"arms\.(\w+)", one)))
    return [_plain(one, list(own)) for one in argv]


def _counted(span: re.Match[str]) -> str:
    return ",".join(map(str, range(int(span[1]), int(span[2]) + 1)))


def _plain(override: str, own: list[str]) -> str:
    """A single override; ``layouts=[10..19]`` names each layout from 10 to 19."""
    override = re.sub(r"(?<=[\[,])(\d+)\.\.(\d+)(?=[\],])", _counted, override)
    if re.match(r"(baseline|task)_options\.", override):
        return f"++{override}"
    if override.startswith("arms."):
        return f"++own_arms.{override.removeprefix('arms.')}"
    if own and re.fullmatch(r"arms=\[.*\]", override):
        return f"{override[:-1]}{',' if override[6:-1].strip() else ''}{','.join(own)}]"
    return override
