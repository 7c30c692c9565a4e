"""``gvla2 bench``: measure a suite on a data set, and make the table."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from omegaconf import OmegaConf

from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.commands.bench_config import BenchConfig
    from gvla2.evaluation.results import Cell
    from gvla2.plugins.registry import Registry

_GEOMETRY = frozenset(("prior", "axis", "fusion", "renderer"))
_MEMORY = frozenset(("retriever", "embedder", "inducer", "judge"))
_ARMS = frozenset(("arms", "own_arms"))
_EPISODES = frozenset(
    (
        "robot", "camera", "perceiver", "planner", "depth_noise", "scale", "tasks", "episodes",
    )
)  # fmt: skip
EVERY = frozenset(("suite", "results", "quiet", "experiment"))
"""Options of every suite."""
SUITES: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "reconstruction": _GEOMETRY | {
            "data", "baselines", "baseline_options", "drifts", "variants", "noise", "seeds", "branch",
            "lpips_weights", "surface_samples", "workers",
        },
        "memory": frozenset(("memory", "data")),
        "robot": _EPISODES | _GEOMETRY | _MEMORY | _ARMS | {
            "branch", "reconstructor", "verifier", "planners", "planner_options", "fallback", "teacher", "world",
            "families", "task_options", "layouts", "seeds", "exploration_seeds", "exploration", "exploration_replan",
            "replan", "max_parts", "planner_timeout", "videos", "language", "workers",
        },
        "perception": _EPISODES | {"perceivers", "task_options", "seeds", "workers", "language"},
        "agents": _MEMORY | _ARMS | {"agents", "agent", "verifier", "language", "seeds"},
        "trajectories": _MEMORY | {"agents", "verifier", "language", "seeds"},
    }
)  # fmt: skip
"""The suites by name, and the options of each besides :data:`EVERY`.

The module ``bench_NAME`` has ``run(bench: BenchRun) -> cells``, all rows of the design in order, and ``DATA`` where
that is fixed.
"""

log = logging.getLogger(__name__)


def job(config: BenchConfig, registry: Registry, folder: Path) -> float:
    """As :func:`run_bench`, after checking that this suite uses every option given.

    Raises :class:`ConfigurationError` where it does not.
    """
    from hydra.core.hydra_config import HydraConfig

    check_options(config.suite, HydraConfig.get().overrides.task)
    return run_bench(config, registry, folder)


def run_bench(config: BenchConfig, registry: Registry, folder: Path) -> float:
    """Run the bench into ``folder``; returns the share of cells that could be measured.

    It leaves ``result.json``, ``index.html``, ``report.md``, ``report.tex`` and ``pictures``. Raises
    :class:`ConfigurationError` for a missing suite, data set or component; an object that cannot be measured gives a
    row with a status, not an error.
    """
    from importlib import import_module

    from gvla2.commands.bench_frame import BenchRun
    from gvla2.commands.report import begin_run, publish
    from gvla2.evaluation.provenance import code_digest, commit, versions
    from gvla2.evaluation.results import Results
    from gvla2.io.files import make_folder, write_json

    if config.suite not in SUITES:
        raise ConfigurationError(f"No suite '{config.suite}'. Available: {', '.join(SUITES)}.")
    suite = import_module(f"gvla2.commands.bench_{config.suite}")
    make_folder(folder)
    with Results.open(config.results.url) as results:
        composed = OmegaConf.to_yaml(OmegaConf.structured(config))
        run_id = begin_run(results, config.suite, folder, composed, code_digest(("gvla2",)))
        measured: list[Cell] = suite.run(BenchRun(config, registry, results, run_id, folder))
        # Rows measured just now have no run yet.
        cells = [cell if cell.run else replace(cell, run=run_id) for cell in measured]
        told = {
            "command": "bench",
            "suite": config.suite,
            "data": getattr(suite, "DATA", config.data.kind),
            "run": run_id,
            "database": results.url,
            "commit": commit(),
            "versions": versions(),
            "rows": [{**cell.flat(), "run": cell.run} for cell in cells],
        }
        write_json(folder / "result.json", told)
        used = {cell.run for cell in cells}
        runs = [run for run in results.runs(config.suite) if run.id in used]
        publish(cells, runs, config.suite, folder)
    failed = Counter(str(c.notes["status"]) for c in cells if c.notes.get("status") != "ok")
    for status, count in failed.items():
        log.warning("%d of %d cells %s", count, len(cells), status)
    if not config.quiet:
        print(f"Report: {folder / 'index.html'}")
    return 1 - sum(failed.values()) / max(len(cells), 1)


def check_options(suite: str, overrides: Iterable[str]) -> None:
    """Raises :class:`ConfigurationError` for an override (``name=value``) that would do nothing in the suite."""
    if (own := SUITES.get(suite)) is None:
        return
    named = [m[1] for one in overrides if (m := re.match(r"[+~]*([A-Za-z_]\w*)", one))]
    for name in dict.fromkeys(named):
        others = [other for other, options in SUITES.items() if name in options]
        if name not in own | EVERY and others:
            shown = "arms" if name == "own_arms" else name
            raise ConfigurationError(
                f"{shown} does nothing in the suite {suite}: it is an option of {', '.join(others)}. "
                f"The suite {suite} takes {', '.join(sorted(own))}."
            )


def main(argv: list[str]) -> int:
    """Entry of ``gvla2 bench [suite] [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    return launch("bench", job, as_overrides(argv))


def as_overrides(argv: list[str]) -> list[str]:
    """The arguments in Hydra's terms.

    A leading word, as in ``gvla2 bench robot``, chooses the suite. Options under a component's or an arm's name
    (``planner_options.agent3d.tries=1``, ``arms.mine={memory: governed}``) are new to the configuration, for which
    Hydra needs a ``+``; custom arms are added to the listed ``arms``.
    """
    word = argv[0] if argv else ""
    told = [f"suite={word}", *argv[1:]] if re.fullmatch(r"\w+", word) else argv
    own = dict.fromkeys(match[1] for one in told if (match := re.match(r"arms\.(\w+)", one)))
    return [_plain(one, list(own)) for one in told]


def _plain(override: str, own: list[str]) -> str:
    if re.match(r"(planner|baseline|task)_options\.", override):
        return f"++{override}"
    if override.startswith("arms."):
        return f"++own_arms.{override.removeprefix('arms.')}"
    if own and re.fullmatch(r"arms=\[.*\]", override):
        return f"{override[:-1]}{',' if override[6:-1].strip() else ''}{','.join(own)}]"
    return override
